"""OpenCL: any GPU, and CPUs through PoCL or Intel's runtime."""

from __future__ import annotations

import logging
import os
import threading
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import DTypeLike, NDArray

from stereo_gpu.backends import oclgrind, pocl
from stereo_gpu.backends.contract import KEPT_SCRATCH_BYTES, Backend, DeviceArray, DeviceStatus, Kind, host_memory
from stereo_gpu.backends.share import processes
from stereo_gpu.errors import BackendError, MemoryLimitError
from stereo_gpu.kernels.geometry import Geometry, geometry
from stereo_gpu.kernels.opencl import parameters, program_source, together

_log = logging.getLogger(__name__)
# The process that asked the drivers first: their threads do not live on in one that is forked off it.
_process: list[int] = []
_ELEMENTS = {"float": np.float32, "int": np.int32, "uchar": np.uint8, "ushort": np.uint16}
_PIXELS = {np.dtype(np.uint8): "uchar", np.dtype(np.uint16): "ushort", np.dtype(np.float32): "float"}
# OpenCL lets a GPU round quotients by 2.5 units in the last place. NVIDIA's differ from a processor's without this.
_ROUNDED = "-cl-fp32-correctly-rounded-divide-sqrt"
_INSTALL = "pip install pocl-binary-distribution, or apt-get install pocl-opencl-icd"


@dataclass(frozen=True)
class Limits:
    """What a backend believes that a device allows; None is what the driver says.

    Args:
        work_group: work-items of a group, at most.
        local_bytes: local memory of a group.
    """

    work_group: int | None = None
    local_bytes: int | None = None


def statuses() -> list[DeviceStatus]:
    """Every OpenCL device, best first, or the reason why there is none."""
    try:
        found = _devices()
    except cl.Error as error:
        return [DeviceStatus("opencl", "no OpenCL driver", "cpu", _first_line(error), _INSTALL)]
    except BackendError as error:
        return [DeviceStatus("opencl", "OpenCL", "cpu", *str(error).split(": ", 1))]
    if not found:
        return [DeviceStatus("opencl", "no OpenCL device", "cpu", "no driver offers a device", _INSTALL)]
    return [_status(name, device) for name, device in found]


def open_device(part: str = "", form: Kind | None = None, limits: Limits = Limits()) -> Backend:
    """Open the device called `part`, else the best one whose platform's or own name contains it, whatever the case.

    `part` may end in "#2" for the second of several that it fits. `form` and `limits` as in OpenCLBackend.

    Raises:
        BackendError: there is none; the message lists those that are.
    """
    listed = statuses()
    usable = {status.name for status in listed if status.available}
    named = [(name, device) for name, device in _devices() if name in usable] if usable else []
    for name, device in named:
        if name.lower() == f"opencl:{part}".lower():
            return OpenCLBackend(device, form, limits, name)
    stem, _, number = part.partition("#")
    fitting = [(n, d) for n, d in named if stem.lower() in f"{d.platform.name} {d.name}".lower()]
    place = int(number) - 1 if number.isdigit() else 0 if part == stem else -1
    if 0 <= place < len(fitting):
        name, device = fitting[place]
        return OpenCLBackend(device, form, limits, name)
    what = f"no OpenCL device has {part!r} in its name" if part else "no OpenCL device can be used"
    there = "; ".join(s.name + (f" ({s.reason})" if s.reason else "") for s in listed)
    raise BackendError(f"{what}; there is: {there}. Mend: choose one of `stereo-gpu devices`, or {_INSTALL}")


class OpenCLBackend(Backend):
    """One OpenCL device with an in-order queue; programs are compiled once and cached on disk by the driver.

    Args:
        device: the device.
        form: which form of the kernels to run; the device's own by default.
        limits: what the device allows, where that is less than its driver says.
        name: the name that opens it again.
    """

    def __init__(
        self, device: cl.Device, form: Kind | None = None, limits: Limits = Limits(), name: str | None = None
    ) -> None:
        obstacle, remedy = pocl.obstacle(device)
        if obstacle:
            raise BackendError(f"{device.name.strip()}: {obstacle}: {remedy}")
        self.name = name or f"opencl:{device.name.strip()}"
        self.device = f"{device.name.strip()}, {device.platform.name.strip()}, {device.version.strip()}"
        self.driver = f"{device.platform.name.strip()} {device.driver_version.strip()}"
        named = pocl.processor(device)
        self.compiler = " ".join(device.platform.version.split()) + (f", for {named}" if named else "")
        self.kind: Kind = _kind(device)
        self.form: Kind = form or self.kind
        self._group_limit = min(device.max_work_item_sizes[0], limits.work_group or device.max_work_group_size)
        self._local_bytes = limits.local_bytes or device.local_mem_size
        self._device = device
        self._context = cl.Context([device])
        self._queue = cl.CommandQueue(self._context, properties=cl.command_queue_properties.PROFILING_ENABLE)
        self._events: list[tuple[str, list[cl.Event]]] | None = None
        self._simulated = oclgrind.is_oclgrind(device)
        self._kept: list[cl.Buffer] = []
        self._kernels: dict[tuple[str, str], cl.Kernel] = {}
        self._scratch: cl.Buffer | None = None
        # A kernel object holds its arguments, so setting them and the launch must not be split by a thread.
        self._lock = threading.Lock()

    def upload(self, array: NDArray[Any]) -> DeviceArray:
        """Copy an array to the device."""
        held = self.empty(array.shape, array.dtype)
        cl.enqueue_copy(self._queue, held.handle, np.ascontiguousarray(array))
        return held

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Make an array on the device, its content undefined."""
        element = np.dtype(dtype)
        return DeviceArray(shape, element, self._buffer(int(np.prod(shape)) * element.itemsize))

    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Make an array of zeros on the device."""
        array = self.empty(shape, dtype)
        self.clear(array)
        return array

    def clear(self, array: DeviceArray) -> None:
        """Fill an array on the device with zeros."""
        if self._simulated:
            cl.enqueue_copy(self._queue, array.handle, np.zeros(array.shape, array.dtype))
        else:
            cl.enqueue_fill_buffer(self._queue, array.handle, np.uint8(0), 0, array.handle.size)

    def download(self, array: DeviceArray) -> NDArray[Any]:
        """Copy an array back to the host, after all launches so far."""
        result = np.empty(array.shape, array.dtype)
        cl.enqueue_copy(self._queue, result, array.handle)
        return result

    def copy(self, source: DeviceArray, target: DeviceArray) -> None:
        """Copy an array to another one of the same size, both on the device."""
        cl.enqueue_copy(self._queue, target.handle, source.handle)

    def launch(self, kernel: str, **arguments: DeviceArray | int | float) -> None:
        """Run a kernel; arguments by the names in its signature, less those that its geometry decides."""
        plan = self._plan(kernel, arguments)
        values = {**arguments, **plan.scalars, "stage": 0}
        wanted = parameters(kernel)
        with self._lock:
            if plan.scratch_floats:
                if self._scratch is None or self._scratch.size < plan.scratch_floats * 4:
                    self._scratch = None
                    self._scratch = self._buffer(plan.scratch_floats * 4)
                values["scratch"] = DeviceArray((plan.scratch_floats,), np.dtype(np.float32), self._scratch)
            pixel = next((_PIXELS[values[p.name].dtype] for p in wanted if p.type == "PIXEL"), "")
            program = self._kernel(kernel, pixel)
            program.set_args(*(self._cast(kernel, p, values) for p in wanted))
            counter = next((place for place, p in enumerate(wanted) if p.name == "stage"), None)
            local = self._local_size(kernel, plan, program)
            padded = tuple(-(-size // group) * group for size, group in zip(plan.size, local, strict=True))
            stages = []
            try:
                for stage in range(plan.stages):
                    if counter is not None:
                        program.set_arg(counter, np.int32(stage))
                    stages.append(cl.enqueue_nd_range_kernel(self._queue, program, padded, local))
            except cl.Error as error:
                raise BackendError(f"kernel {kernel} failed on {self.device}: {_first_line(error)}") from error
            if self._events is not None:
                self._events.append((kernel, stages))

    def finish(self) -> None:
        """Wait until all launches are done, and let go of a large scratch."""
        self._queue.finish()
        with self._lock:
            if self._scratch is not None and self._scratch.size > KEPT_SCRATCH_BYTES:
                self._scratch = None

    @contextmanager
    def device_times(self) -> Iterator[list[tuple[str, float]]]:
        """Collect (kernel, seconds on the device) of every launch inside; the list is full once the block ends."""
        times: list[tuple[str, float]] = []
        events: list[tuple[str, list[cl.Event]]] = []
        self._events = events
        try:
            yield times
        finally:
            self._events = None
        self._queue.finish()
        for kernel, stages in events:
            times.append((kernel, 1e-9 * sum(event.profile.end - event.profile.start for event in stages)))

    def available_bytes(self) -> tuple[int, int]:
        """Bytes that can still be taken in all, and for one array."""
        total = self._device.global_mem_size // processes()
        if self.kind == "cpu":
            # The scratch that is held already serves the next job too.
            held = self._scratch
            total = min(total, host_memory() // processes() + (held.size if held else 0))
        return total, min(total, self._device.max_mem_alloc_size)

    def scratch_bytes(self, kernel: str, **arguments: int) -> int:
        """Bytes of scratch that a launch takes beside its arguments."""
        return 4 * int(self._plan(kernel, arguments).scratch_floats)

    def _plan(self, kernel: str, arguments: Mapping[str, Any]) -> Geometry:
        return geometry(kernel, "opencl", self.form, arguments, self._device.max_compute_units)

    def _buffer(self, size: int) -> cl.Buffer:
        _check_process()
        try:
            buffer = cl.Buffer(self._context, cl.mem_flags.READ_WRITE, max(size, 4))
            if self._simulated:
                self._kept.append(buffer)
            return buffer
        except (cl.Error, MemoryError) as error:
            raise MemoryLimitError(
                f"{self.device} cannot give {size:,} bytes ({_first_line(error)}): use a smaller picture or range"
            ) from error

    def _kernel(self, kernel: str, pixel: str) -> cl.Kernel:
        if (kernel, pixel) not in self._kernels:
            names = together(kernel)
            text = program_source(names, self.form)
            # Without -w PoCL's compiler counts its warnings on the user's terminal when it first builds a kernel.
            options = ["-cl-std=CL1.2", "-w", *pocl.build_options(self._device)]
            options += [f"-DPIXEL={pixel}"] if pixel else []
            options += [_ROUNDED] if self.kind == "gpu" and _can_round(self._device) else []
            if self._simulated:
                text, options = oclgrind.PRELUDE + text, [*options, *oclgrind.BUILD_OPTIONS]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", cl.CompilerWarning)
                try:
                    program = cl.Program(self._context, text)
                    program = program.build(options, cache_dir=False if self._simulated else None)
                    self._kernels |= {(name, pixel): cl.Kernel(program, name) for name in names}
                except cl.Error as error:
                    failure = BackendError(f"kernel {kernel} does not compile on {self.device}: {_first_line(error)}")
                    failure.add_note(str(error))
                    raise failure from error
        return self._kernels[kernel, pixel]

    def _cast(self, kernel: str, parameter: Any, values: dict[str, Any]) -> Any:
        if parameter.name not in values:
            raise TypeError(f"kernel {kernel} needs {parameter.name}")
        value = values[parameter.name]
        if not parameter.array:
            return _ELEMENTS[parameter.type](value)
        wanted = _ELEMENTS.get(parameter.type, value.dtype)
        if value.dtype != wanted:
            raise TypeError(f"kernel {kernel}: {parameter.name} is {value.dtype}, not {np.dtype(wanted)}")
        return value.handle

    def _local_size(self, kernel: str, plan: Geometry, program: cl.Kernel) -> tuple[int, ...]:
        info = cl.kernel_work_group_info
        limit = min(self._group_limit, program.get_work_group_info(info.WORK_GROUP_SIZE, self._device))
        local = program.get_work_group_info(info.LOCAL_MEM_SIZE, self._device)
        if plan.group > limit or local > self._local_bytes:
            raise BackendError(
                f"kernel {kernel} needs groups of {plan.group} and {local:,} bytes of local memory, {self.device} "
                f"allows {limit} and {self._local_bytes:,}: use warp:cpu, or another device of `stereo-gpu devices`"
            )
        # One row of neighbours: they read neighbouring addresses on a GPU and fill the vectors of a CPU.
        any_number = min(64, limit, _power_of_two(plan.size[0]))
        return (plan.group or (1 if plan.alone else any_number), *(1 for _ in plan.size[1:]))


def _check_process() -> None:
    """Refuse to go on in a process that was forked off one that uses OpenCL: its drivers would wait for ever."""
    if not _process:
        _process.append(os.getpid())
    if _process[0] != os.getpid():
        raise BackendError(
            "OpenCL was used before this process was forked, and its drivers' threads are gone: start processes with"
            ' multiprocessing.get_context("spawn"), or use backend warp:cpu'
        )


def _devices() -> list[tuple[str, cl.Device]]:
    """Every device with its name, GPUs first, then by size; of equal names the second ends in "#2", and so on.

    A platform that cannot be asked is left out with its reason logged.
    """
    _check_process()
    found = []
    for platform in cl.get_platforms():
        try:
            found += platform.get_devices()
        except cl.Error as error:
            _log.warning("OpenCL platform %s: %s", platform.name, _first_line(error))
    found.sort(key=lambda d: (_kind(d) != "gpu", -d.max_compute_units * d.max_clock_frequency))
    seen: Counter[str] = Counter()
    named = []
    for device in found:
        name = f"opencl:{device.name.strip()}"
        seen[name] += 1
        named.append((name if seen[name] == 1 else f"{name}#{seen[name]}", device))
    return named


def _status(name: str, device: cl.Device) -> DeviceStatus:
    label = f"{device.name.strip()} ({device.platform.name.strip()})"
    if not (device.available and device.compiler_available):
        reason, remedy = "the driver says that it is not available", "reinstall the driver"
    else:
        reason, remedy = pocl.obstacle(device)
    return DeviceStatus(name, label, _kind(device), reason, remedy)


def _kind(device: cl.Device) -> Kind:
    return "cpu" if device.type & cl.device_type.CPU else "gpu"


def _can_round(device: cl.Device) -> bool:
    """Whether quotients and roots can be rounded as processors round them, if they are told to."""
    return bool(device.single_fp_config & cl.device_fp_config.CORRECTLY_ROUNDED_DIVIDE_SQRT)


def _power_of_two(size: int) -> int:
    return 1 << max(0, size - 1).bit_length()


def _first_line(error: BaseException) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
