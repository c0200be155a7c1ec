"""What the benchmark runs on: the machine, the versions, and the roofs of each device, measured."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.backends.contract import host_memory
from stereo_gpu.backends.share import usable_cores

PACKAGES = ("stereo-gpu", "numpy", "opencv-python-headless", "pyopencl", "pocl-binary-distribution", "warp-lang")
COPIED_BYTES = 256 << 20  # far larger than any cache
SHARE_OF_MEMORY = 8  # a copy takes at most this part of what is free
PRODUCT_SIDE = 2048  # of the matrices that are multiplied
CHAIN_SIZE = (1024, 1024)
CHAIN_ROUNDS = 512
OPERATIONS_A_ROUND = 16  # of kernel multiply_add: eight chains, a product and a sum each
TRIES = 25
INSTRUCTIONS = ("avx512f", "avx2", "sse4_2", "asimd")  # as Linux names them, the widest first


@dataclass(frozen=True, kw_only=True)
class DeviceFacts:
    """A device, its software, and the two roofs over every kernel on it.

    Args:
        name: what `--backend` takes.
        device, driver, compiler: in words, with versions.
        kind: "gpu" or "cpu".
        copy_bytes_s: bytes read and written by a copy of a large array, in a second.
        operations_s: products and sums of float32 in a second.
        roofs: how these two were measured.
    """

    name: str
    device: str
    driver: str
    compiler: str
    kind: str
    copy_bytes_s: float
    operations_s: float
    roofs: str


def describe_device(device: Backend) -> DeviceFacts:
    """Ask a device for its software and measure its roofs, in about a second.

    On the CPU they are what NumPy reaches with all cores, since no driver's own copy uses all of them.
    """
    if device.kind == "cpu":
        copied, counted = _host_copy(), _host_operations()
        roofs = "copy by NumPy in a thread a core; float32 matrix product by NumPy (fused multiply-add)"
    else:
        copied, counted = _device_copy(device), _device_operations(device)
        roofs = "the driver's copy on the device; kernel multiply_add (products and sums, not fused)"
    return DeviceFacts(
        name=device.name,
        device=device.device,
        driver=device.driver,
        compiler=device.compiler,
        kind=device.kind,
        copy_bytes_s=copied,
        operations_s=counted,
        roofs=roofs,
    )


def describe_machine() -> dict[str, Any]:
    """The processor, the system and the versions of what takes part."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    # A release such as 6.8.0-31-generic says more about a provider than about speed.
    system = f"{platform.system()} {'.'.join(platform.release().split('.')[:2])}"
    return {
        "processor": _processor(),
        "cores": usable_cores(),
        "memory_bytes": _memory(),
        "system": f"{system} {platform.machine()}",
        "python": platform.python_version(),
        "opencv": f"{cv2.__version__}, {cv2.getNumThreads()} threads",
        "load_average": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "versions": versions,
    }


def _processor() -> str:
    facts = _read_pairs("/proc/cpuinfo")
    name = facts.get("model name") or platform.processor() or platform.machine()
    flags = facts.get("flags", facts.get("Features", "")).split()
    widest = next((flag for flag in INSTRUCTIONS if flag in flags), "")
    if facts.get("cpu family") and facts.get("model"):
        name += f" (family {facts['cpu family']}, model {facts['model']})"
    return f"{name}, {widest}" if widest else name


def _memory() -> int:
    total = _read_pairs("/proc/meminfo").get("MemTotal", "0 kB").split()[0]
    return int(total) * 1024 if total.isdigit() else 0


def _read_pairs(path: str) -> dict[str, str]:
    """The first value of each name in a file of lines `name: value`; nothing where there is no such file."""
    try:
        lines = Path(path).read_text("utf-8", "replace").splitlines()
    except OSError:
        return {}
    pairs: dict[str, str] = {}
    for line in lines:
        name, _, value = line.partition(":")
        pairs.setdefault(name.strip(), value.strip())
    return pairs


def _elements(device_bytes: int) -> int:
    return max(1 << 18, min(COPIED_BYTES, device_bytes // SHARE_OF_MEMORY) // 4)


@cache
def _host_copy() -> float:
    source = np.ones(_elements(host_memory()), np.float32)
    target = np.zeros_like(source)
    cores = usable_cores()
    parts = [np.s_[len(source) * i // cores : len(source) * (i + 1) // cores] for i in range(cores)]
    with ThreadPoolExecutor(cores) as pool:

        def copy() -> None:
            list(pool.map(lambda part: np.copyto(target[part], source[part]), parts))

        return 2 * source.nbytes / _shortest(copy)


@cache
def _host_operations() -> float:
    left = np.full((PRODUCT_SIDE, PRODUCT_SIDE), 0.5, np.float32)
    product = np.empty_like(left)
    return float(2 * PRODUCT_SIDE**3 / _shortest(lambda: np.matmul(left, left, out=product)))


def _device_copy(device: Backend) -> float:
    source = device.zeros((_elements(device.available_bytes()[1]),), np.float32)
    target = device.empty(source.shape, np.float32)

    def copy() -> None:
        device.copy(source, target)
        device.finish()

    return 8 * source.shape[0] / _shortest(copy)


def _device_operations(device: Backend) -> float:
    width, height = CHAIN_SIZE
    held = device.empty((height, width), np.float32)

    def run() -> float:
        with device.device_times() as times:
            device.launch(
                "multiply_add",
                width=width,
                height=height,
                rounds=CHAIN_ROUNDS,
                factor=0.999,
                summand=0.001,
                sum_out=held,
            )
        return sum(seconds for _, seconds in times)

    run()
    return width * height * CHAIN_ROUNDS * OPERATIONS_A_ROUND / min(run() for _ in range(TRIES))


def _shortest(work: Callable[[], object]) -> float:
    """Seconds of the best of a few tries: a roof is what can be reached, not what a busy machine gave."""
    best = float("inf")
    for _ in range(TRIES):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return best
