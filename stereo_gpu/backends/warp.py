"""Warp: CUDA, and the CPU for tests."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import DTypeLike, NDArray

from stereo_gpu.backends.bands import Crew, banded, cut
from stereo_gpu.backends.contract import KEPT_SCRATCH_BYTES, Backend, DeviceArray, DeviceStatus, Kind, host_memory
from stereo_gpu.backends.cuda import has_cuda_driver
from stereo_gpu.backends.share import processes, usable_cores
from stereo_gpu.errors import BackendError, MemoryLimitError
from stereo_gpu.kernels.geometry import Geometry, geometry
from stereo_gpu.kernels.warp import program as find_program

_ELEMENTS = {
    np.dtype(np.uint8): wp.uint8,
    np.dtype(np.uint16): wp.uint16,
    np.dtype(np.int32): wp.int32,
    np.dtype(np.float32): wp.float32,
}
# Warp compiles and loads kernels in one thread at a time, whatever the device; launches on the CPU let others run,
# which must not write to the same scratch.
_LOCK = threading.Lock()
_STARTING = threading.Lock()
_started: list[bool] = []
LARGEST_LENGTH = 2**31 - 1  # elements of a Warp array; the largest ones hold four bytes each
_DRIVER = "install NVIDIA's driver (for example apt-get install nvidia-driver) and reboot"


def statuses() -> list[DeviceStatus]:
    """Every CUDA device that Warp sees, or the reason why there is none, and the CPU."""
    found = []
    if has_cuda_driver():
        _initialise()
        found = [DeviceStatus(f"warp:{d.alias}", d.name, "gpu") for d in wp.get_cuda_devices()]
        if not found:
            reason = "the CUDA driver is there, but no device"
            found = [DeviceStatus("warp:cuda:0", "CUDA through Warp", "gpu", reason, "nvidia-smi shows what is wrong")]
    else:
        reason = "the CUDA driver (libcuda) cannot be loaded"
        found = [DeviceStatus("warp:cuda:0", "CUDA through Warp", "gpu", reason, _DRIVER)]
    return [*found, DeviceStatus("warp:cpu", f"CPU through Warp {wp.__version__}", "cpu")]


def open_device(part: str) -> Backend:
    """Open "cpu" or "cuda:0", "cuda:1" and so on.

    Raises:
        BackendError: there is no such device.
    """
    listed = statuses()
    for status in listed:
        if status.name == f"warp:{part}" and status.available:
            return WarpBackend(part)
    there = ", ".join(s.name if s.available else f"{s.name} ({s.reason}: {s.remedy})" for s in listed)
    raise BackendError(f"backend 'warp:{part}' cannot be used; there is: {there}")


class WarpBackend(Backend):
    """One Warp device; kernels are compiled once and cached on disk by Warp.

    Args:
        alias: "cpu", or "cuda:0" and so on.
        form: which form of the kernels to run; the device's own by default.
        threads: how many threads run a launch on the CPU; None takes every core that this process may use.
    """

    def __init__(self, alias: str, form: Kind | None = None, threads: int | None = None) -> None:
        _initialise()
        self._device = wp.get_device(alias)
        self.name = f"warp:{alias}"
        self.device = f"{self._device.name}, Warp {wp.__version__}"
        self.kind: Kind = "gpu" if self._device.is_cuda else "cpu"
        self.driver, self.compiler = _software(self.kind)
        self.form: Kind = form or self.kind
        if self.form != self.kind:
            # Runs the threads of a block in turns, where they wait for each other.
            wp.config.enable_cpu_blocks = True
        self._times: list[tuple[str, Any]] | None = None
        self._scratch: wp.array | None = None
        self._crew = Crew(1 if self._device.is_cuda else threads or usable_cores())

    def upload(self, array: NDArray[Any]) -> DeviceArray:
        """Copy an array to the device."""
        flat = np.ascontiguousarray(array).reshape(-1)
        # copy=True: on the CPU Warp would otherwise look at the caller's memory.
        held = wp.array(flat, dtype=_ELEMENTS[flat.dtype], device=self._device, copy=True)
        return DeviceArray(array.shape, flat.dtype, held)

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Make an array on the device, its content undefined."""
        return self._make(wp.empty, shape, dtype)

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Make an array of zeros on the device."""
        return self._make(wp.zeros, shape, dtype)

    def clear(self, array: DeviceArray) -> None:
        """Fill an array on the device with zeros."""
        array.handle.zero_()

    def download(self, array: DeviceArray) -> NDArray[Any]:
        """Copy an array back to the host, after all launches so far."""
        result: NDArray[Any] = array.handle.numpy().reshape(array.shape)
        return result.copy() if self.kind == "cpu" else result

    def copy(self, source: DeviceArray, target: DeviceArray) -> None:
        """Copy an array to another one of the same size, both on the device."""
        wp.copy(target.handle, source.handle)

    def launch(self, kernel: str, **arguments: DeviceArray | int | float) -> None:
        """Run a kernel; arguments by the names in its signature, less those that its geometry decides."""
        program = find_program(kernel, self.form)
        plan = self._plan(kernel, arguments)
        values: dict[str, Any] = {**arguments, **plan.scalars, "stage": 0}
        with _LOCK:
            if plan.scratch_floats:
                if self._scratch is None or self._scratch.size < plan.scratch_floats:
                    self._scratch = None
                    self._scratch = self._make(wp.empty, (plan.scratch_floats,), np.float32).handle
                values["scratch"] = DeviceArray((plan.scratch_floats,), np.dtype(np.float32), self._scratch)
            wanted = [parameter.label for parameter in program.adj.args]
            missing = [name for name in wanted if name not in values]
            if missing:
                raise TypeError(f"kernel {kernel} needs {missing[0]}")
            start = self._now() if self._times is not None else None
            try:
                for stage in range(plan.stages):
                    values["stage"] = stage
                    self._run(program, plan, [_handle(values[name]) for name in wanted])
            except RuntimeError as error:
                raise BackendError(f"kernel {kernel} failed on {self.device}: {error}") from error
            if self._times is not None:
                self._times.append((kernel, (start, self._now())))

    def _run(self, program: Any, plan: Geometry, inputs: list[Any]) -> None:
        size = plan.size[::-1]  # Warp counts axes from the slowest, OpenCL from the fastest
        # Work-items of a group wait for each other, which on the CPU only those of one thread can.
        if self._device.is_cuda or plan.whole or plan.group or self._crew.threads == 1:
            block = plan.group or (256 if self._device.is_cuda else 1)  # 256 and 1 are Warp's own choice
            wp.launch(program, dim=size, inputs=inputs, device=self._device, block_dim=block)
            return
        # Recorded here, since Warp compiles a kernel when it is first asked for, which two threads must not do.
        bands = [
            wp.launch(
                banded(program), dim=(count, *size[1:]), inputs=[first, *inputs], device=self._device, record_cmd=True
            )
            for first, count in cut(size[0], self._crew.threads)
        ]
        self._crew.run([band.launch for band in bands])

    def finish(self) -> None:
        """Wait until all launches are done, and let go of a large scratch."""
        wp.synchronize_device(self._device)
        with _LOCK:
            if self._scratch_held() > KEPT_SCRATCH_BYTES:
                self._scratch = None

    @contextmanager
    def device_times(self) -> Iterator[list[tuple[str, float]]]:
        """Collect (kernel, seconds on the device) of every launch inside; the list is full once the block ends."""
        result: list[tuple[str, float]] = []
        times: list[tuple[str, Any]] = []
        self._times = times
        try:
            yield result
        finally:
            self._times = None
        self.finish()
        for kernel, (start, end) in times:
            elapsed = 1e-3 * wp.get_event_elapsed_time(start, end) if self._device.is_cuda else end - start
            result.append((kernel, elapsed))

    def _now(self) -> Any:
        """A mark on the device's own clock; launches on the CPU have ended when they return."""
        if not self._device.is_cuda:
            return time.perf_counter()
        return self._device.stream.record_event(wp.Event(self._device, enable_timing=True))

    def available_bytes(self) -> tuple[int, int]:
        """Bytes that can still be taken in all, and for one array."""
        free = (self._device.free_memory if self._device.is_cuda else host_memory()) // processes()
        # The scratch that is held already serves the next job too.
        free += self._scratch_held()
        return free, min(free, 4 * LARGEST_LENGTH)

    def scratch_bytes(self, kernel: str, **arguments: int) -> int:
        """Bytes of scratch that a launch takes beside its arguments."""
        return 4 * int(self._plan(kernel, arguments).scratch_floats)

    def _scratch_held(self) -> int:
        held = self._scratch
        return 0 if held is None else 4 * int(held.size)

    def _plan(self, kernel: str, arguments: Mapping[str, Any]) -> Geometry:
        units = self._device.sm_count if self._device.is_cuda else self._crew.threads
        return geometry(kernel, "warp", self.form, arguments, units)

    def _make(self, maker: Any, shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        element, length = np.dtype(dtype), int(np.prod(shape))
        try:
            return DeviceArray(shape, element, maker(length, dtype=_ELEMENTS[element], device=self._device))
        except (RuntimeError, MemoryError, ValueError) as error:
            size = length * element.itemsize
            raise MemoryLimitError(
                f"{self.device} cannot give {size:,} bytes: use a smaller picture or range"
            ) from error


def _handle(value: Any) -> Any:
    """What Warp is given for an argument."""
    return value.handle if isinstance(value, DeviceArray) else value


def _software(kind: Kind) -> tuple[str, str]:
    """Driver and compiler with their versions."""
    if kind == "cpu":
        return "none", f"the LLVM within Warp {wp.__version__}"
    driver, toolkit = (".".join(map(str, v)) for v in (wp.get_cuda_driver_version(), wp.get_cuda_toolkit_version()))
    return f"CUDA driver {driver}", f"the CUDA {toolkit} compiler within Warp {wp.__version__}"


def _initialise() -> None:
    """Start Warp without its banner, and without its complaint about a CUDA driver that is known to be missing."""
    with _STARTING:
        if not _started:
            _start()
            _started.append(True)


def _start() -> None:
    wp.config.log_level = wp.LOG_WARNING
    if has_cuda_driver():
        wp.init()
        return
    # The complaint is written by Warp's C++ side straight to the file descriptor.
    kept = os.dup(2)
    silence = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(silence, 2)
        wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(silence)
