"""What a backend must do: hold arrays on a device and launch kernels on them by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import DTypeLike, NDArray

from stereo_gpu.errors import MemoryLimitError

Kind = Literal["gpu", "cpu"]
# Scratch up to this size is kept between launches; a larger one goes when the device has nothing to do.
KEPT_SCRATCH_BYTES = 64 << 20


@dataclass(frozen=True)
class DeviceArray:
    """An array on a device: its shape, its element type, and the backend's own handle."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    handle: Any


@dataclass(frozen=True)
class DeviceStatus:
    """What `devices` tells of one device.

    Args:
        name: what to pass as `backend`.
        label: the device in words.
        kind: "gpu" or "cpu".
        reason: why it cannot be used; empty when it can.
        remedy: the command that would mend it.
    """

    name: str
    label: str
    kind: Kind
    reason: str = ""
    remedy: str = ""

    @property
    def available(self) -> bool:
        """Whether it can be used now."""
        return not self.reason


class Backend(ABC):
    """One device. Arrays stay on it from upload to download; kernels run in the order of their launches.

    Attributes:
        name: the name that opens it again, such as "warp:cpu".
        device: the device and its driver in words.
        driver, compiler: what runs the kernels and what compiles them, with versions.
        kind: "gpu" or "cpu".
        form: which form of those kernels runs that have one for GPUs and one for CPUs; the device's kind, but tests
            run either form on any device.
    """

    name: str
    device: str
    driver: str
    compiler: str
    kind: Kind
    form: Kind

    @abstractmethod
    def upload(self, array: NDArray[Any]) -> DeviceArray:
        """Copy an array to the device."""

    @abstractmethod
    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Make an array on the device, its content undefined."""

    @abstractmethod
    def zeros(self, shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
        """Make an array of zeros on the device."""

    @abstractmethod
    def clear(self, array: DeviceArray) -> None:
        """Fill an array on the device with zeros."""

    @abstractmethod
    def download(self, array: DeviceArray) -> NDArray[Any]:
        """Copy an array back to the host, after all launches so far."""

    @abstractmethod
    def copy(self, source: DeviceArray, target: DeviceArray) -> None:
        """Copy an array to another one of the same size, both on the device."""

    @abstractmethod
    def launch(self, kernel: str, **arguments: DeviceArray | int | float) -> None:
        """Run a kernel; arguments by the names in its signature, less those that its geometry decides."""

    @abstractmethod
    def finish(self) -> None:
        """Wait until all launches are done."""

    @abstractmethod
    def device_times(self) -> AbstractContextManager[list[tuple[str, float]]]:
        """Collect (kernel, seconds on the device) of every launch inside; the list is full once the block ends."""

    @abstractmethod
    def scratch_bytes(self, kernel: str, **arguments: int) -> int:
        """Bytes of scratch that a launch takes beside its arguments.

        Args:
            kernel: its name.
            arguments: those by which its size is decided, such as width, height and disparities.
        """

    @abstractmethod
    def available_bytes(self) -> tuple[int, int]:
        """Bytes that can still be taken in all, and for one array."""

    def check_memory(self, needed: int, largest: int, remedy: str) -> None:
        """Refuse a job before it takes memory.

        Args:
            needed: bytes in all.
            largest: bytes of the largest array.
            remedy: the option that would make the job fit.

        Raises:
            MemoryLimitError: with both figures and the remedy.
        """
        available, one = self.available_bytes()
        if needed > available:
            raise MemoryLimitError(
                f"needs {needed:,} bytes on {self.name} ({self.device}), {available:,} are available: {remedy}"
            )
        if largest > one:
            raise MemoryLimitError(
                f"needs one array of {largest:,} bytes, {self.name} ({self.device}) allows {one:,}: {remedy}"
            )


def host_memory() -> int:
    """Bytes of main memory that this process can still take: the system's figure or its container's limit."""
    bounds = [int(line.split()[1]) * 1024 for line in _lines("/proc/meminfo") if line.startswith("MemAvailable:")]
    limit, used = _lines("/sys/fs/cgroup/memory.max"), _lines("/sys/fs/cgroup/memory.current")
    if limit and used and limit[0].isdigit():
        bounds.append(max(0, int(limit[0]) - int(used[0])))
    # No such files outside of Linux: nothing is known, so nothing is refused.
    return min(bounds, default=1 << 62)


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text("ascii").splitlines()
    except OSError:
        return []
