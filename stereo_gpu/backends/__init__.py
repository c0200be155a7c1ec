"""The devices that can compute, found by name and opened once.

Names: "warp:cuda:0", "warp:cpu", "opencl" (the best device) or "opencl:<part of a platform's or device's name>".
"""

from __future__ import annotations

import logging
import os
import threading
from functools import cache

from stereo_gpu.backends.contract import Backend, DeviceArray, DeviceStatus
from stereo_gpu.backends.cuda import has_cuda_driver
from stereo_gpu.errors import BackendError

__all__ = ["Backend", "DeviceArray", "DeviceStatus", "devices", "open_backend"]

_log = logging.getLogger(__name__)
# Backends by every name that opened them. A device has one, with one queue and one scratch, whatever it was called.
_opened: dict[str, Backend] = {}
# Drivers and compilers are started by one thread.
_opening = threading.Lock()
_INSTALL = {"warp": "pip install warp-lang", "opencl": "pip install pyopencl pocl-binary-distribution"}


def devices() -> list[DeviceStatus]:
    """List what can compute here and, for the rest, why not and what would mend it; best first."""
    found = [*_statuses("warp"), *_statuses("opencl")]
    return sorted(found, key=_rank)


def open_backend(name: str | None = None) -> Backend:
    """Open a device by name; None takes STEREO_GPU_BACKEND, else the best one that can be used.

    Raises:
        BackendError: there is no such device; the message lists those that are.
    """
    with _opening:
        wanted = name or os.environ.get("STEREO_GPU_BACKEND") or _best()
        backend = _open(wanted)
    _log.info("backend %s: %s", backend.name, backend.device)
    return backend


def _open(name: str) -> Backend:
    if name not in _opened:
        backend = _load(name)
        _opened[name] = _opened.setdefault(backend.name, backend)
    return _opened[name]


def _load(name: str) -> Backend:
    language, _, part = name.partition(":")
    try:
        if language == "warp":
            from stereo_gpu.backends import warp

            return warp.open_device(part or "cpu")
        if language == "opencl":
            from stereo_gpu.backends import opencl

            return opencl.open_device(part)
    except ImportError as error:
        raise BackendError(f"backend {name!r} cannot be loaded ({error}): {_INSTALL[language]}") from error
    raise BackendError(
        f"backend {name!r} is unknown: use warp:cuda:0, warp:cpu, opencl or opencl:<part of a device's name>"
    )


@cache
def _best() -> str:
    """The first usable of: CUDA through Warp, an OpenCL GPU, an OpenCL CPU, Warp on the CPU."""
    found: list[DeviceStatus] = []
    for language in ("warp", "opencl") if has_cuda_driver() else ("opencl", "warp"):
        found += [status for status in _statuses(language) if status.available]
        # Only the CPU through Warp comes after what the other language has, which need not be imported for the rest.
        if any(status.name != "warp:cpu" for status in found):
            break
    if not found:
        raise BackendError("nothing here can compute: see `stereo-gpu doctor`")
    return min(found, key=_rank).name


def _rank(status: DeviceStatus) -> tuple[bool, bool, bool]:
    on_cpu, through_warp = status.kind == "cpu", status.name.startswith("warp")
    # A GPU first, through Warp if it can; on the CPU the OpenCL kernels are the faster ones.
    return not status.available, on_cpu, through_warp == on_cpu


def _statuses(language: str) -> list[DeviceStatus]:
    try:
        if language == "warp":
            from stereo_gpu.backends import warp

            return warp.statuses()
        from stereo_gpu.backends import opencl

        return opencl.statuses()
    except ImportError as error:
        return [DeviceStatus(language, f"{language} backend", "cpu", str(error), _INSTALL[language])]
