"""Look over the installation and every device, and say what would mend what is wrong."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stereo_gpu.backends import devices, open_backend
from stereo_gpu.backends.contract import DeviceStatus, host_memory
from stereo_gpu.errors import StereoError

PACKAGES = (
    "warp-lang",
    "pyopencl",
    "numpy",
    "opencv-python-headless",
    "trimesh",
    "pillow",
    "scipy",
    "pyyaml",
    "xatlas",
    "fast-simplification",
)


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Args:
        what: its name.
        good: whether it is as it should be.
        needed: whether no reconstruction can be made without it.
        detail: version, device or reason.
        remedy: the command that would mend it.
    """

    what: str
    good: bool
    needed: bool
    detail: str
    remedy: str = ""


def examine() -> Iterator[Finding]:
    """Examine Python, the packages, the memory, and every device by running a kernel on it."""
    yield Finding("Python", True, True, f"{platform.python_version()} on {platform.platform()}")
    for name in PACKAGES:
        try:
            yield Finding(name, True, True, importlib.metadata.version(name))
        except importlib.metadata.PackageNotFoundError:
            yield Finding(name, False, True, "not installed", f"pip install {name}")
    memory = host_memory()
    enough = memory > 2 << 30
    yield Finding("memory", enough, False, f"{memory / 2**30:.1f} GiB free", "" if enough else "close other programs")
    listed = devices()
    usable = 0
    for status in listed:
        finding = _try_device(status)
        usable += finding.good
        yield finding
    remedy = "" if usable else "pip install pyopencl pocl-binary-distribution warp-lang"
    yield Finding("a device that computes", usable > 0, True, f"{usable} of {len(listed)} usable", remedy)


def _try_device(status: DeviceStatus) -> Finding:
    """Run the median filter on a device and compare with the value that it must have."""
    if not status.available:
        return Finding(status.name, False, False, f"{status.label}: {status.reason}", status.remedy)
    try:
        backend = open_backend(status.name)
        values = np.arange(9, dtype=np.float32).reshape(3, 3)[::-1]
        filtered = backend.empty((3, 3), np.float32)
        backend.launch("median", disparity=backend.upload(values), width=3, height=3, size=3, disparity_out=filtered)
        right = float(backend.download(filtered)[1, 1]) == 4.0
    except StereoError as error:
        return Finding(status.name, False, False, " ".join(str(error).split()), "see `stereo-gpu doctor --debug`")
    detail = f"{status.label} computes" if right else f"{status.label} computes a wrong median"
    return Finding(status.name, right, False, detail, "" if right else "update its driver")
