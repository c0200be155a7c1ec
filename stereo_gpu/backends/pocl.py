"""What PoCL needs to build kernels, and how PoCL with LLVM 14 gets to know processors newer than that.

PoCL asks LLVM for the processor's name. For one that LLVM does not know the answer is "generic", which clang
then refuses as a target ("unknown target CPU 'generic'", pocl issue 1049), so that PyPI's PoCL 3.0 builds no
kernel on, for example, AMD's Zen 5. No option reaches that name. It stands in the driver's device record in
this process; the name of an older processor with the same instructions, put there, mends the driver for this
process.
"""

from __future__ import annotations

import ctypes
import shutil
from pathlib import Path

import pyopencl as cl

# Processors that LLVM 14 knows, newest first, and the instructions (in the words of /proc/cpuinfo) that its
# compiler may then use. The first one must have AVX-512: PoCL links its library of built-ins for the processor's
# real instructions, and a kernel built for less cannot call the AVX-512 ones.
_TARGETS = (
    ("skylake-avx512", "avx512f avx512bw avx512cd avx512dq avx512vl avx2 fma bmi1 bmi2 abm movbe f16c"),
    ("haswell", "avx2 fma bmi1 bmi2 abm movbe f16c"),
    ("nehalem", "sse4_2 popcnt"),
)
_RECORD_BYTES = 4096  # the name's address stands 640 bytes into the record of PoCL 3.0; others may differ
_POINTER = 8
_TRIES = 3
_NAMES: dict[int, str] = {}  # by the address of the device's record


def obstacle(device: cl.Device) -> tuple[str, str]:
    """What keeps PoCL from building kernels here, and the command that would mend it; empty where nothing does.

    A processor that PoCL does not know is given a name on the way.
    """
    if not _is_pocl(device):
        return "", ""
    if shutil.which("ld") is None:
        return "PoCL links each kernel with the linker ld, which is not installed", "apt-get install binutils"
    if _is_unknown(device) and not _named(device):
        reason = "this PoCL does not know this processor and would refuse every kernel"
        return reason, "use a newer PoCL (with LLVM 15 or newer) or another OpenCL driver"
    return "", ""


def processor(device: cl.Device) -> str:
    """The processor that kernels are built for in the place of one that PoCL does not know; else empty."""
    return _named(device) if _is_pocl(device) and _is_unknown(device) else ""


def build_options(device: cl.Device) -> list[str]:
    """Options for every program on a device.

    PoCL keeps programs on disk by their source, their options and the processor's name as LLVM told it, which
    stays "generic". The name in force goes into the options, or a program that was built for another processor
    could be taken from a folder that two machines share.
    """
    named = processor(device)
    return [f"-DPOCL_PROCESSOR={named}"] if named else []


def _is_pocl(device: cl.Device) -> bool:
    return bool(device.platform.name == "Portable Computing Language")


def _is_unknown(device: cl.Device) -> bool:
    return bool(device.version.strip().endswith("-generic"))


def _named(device: cl.Device) -> str:
    """The name that a device was given; it is looked for once, and again while the record cannot be read."""
    # The list of memory comes in pieces, between which other threads may change it.
    for _ in range(_TRIES):
        if not _NAMES.get(device.int_ptr):
            _NAMES[device.int_ptr] = _name_processor(device)
    return _NAMES[device.int_ptr]


def _name_processor(device: cl.Device) -> str:
    """Give the device a processor that LLVM knows, and say which; empty where the record is not as expected.

    The record holds the addresses of two strings side by side: the target ("x86_64-...-linux-gnu") and the
    processor. Only a processor that reads "generic" is replaced, by a string from the same allocator, and
    nothing is read or written but memory that this process may read or write.
    """
    try:
        flags = set(Path("/proc/cpuinfo").read_text("ascii", "replace").split())
        maps = [line.split() for line in Path("/proc/self/maps").read_text("utf-8").splitlines()]
    except OSError:
        return ""
    target = next((name for name, needed in _TARGETS if flags.issuperset(needed.split())), None)
    if target is None:
        return ""
    spans = [([int(end, 16) for end in span.split("-")], allowed) for span, allowed, *_ in maps]

    def may(use: str, address: int, size: int) -> bool:
        return any(low <= address and address + size <= high and use in allowed for (low, high), allowed in spans)

    def text_at(address: int) -> str:
        pointer = ctypes.c_uint64.from_address(address).value
        return ctypes.string_at(pointer, 64).split(b"\0")[0].decode("latin-1") if may("r", pointer, 64) else ""

    for address in range(device.int_ptr, device.int_ptr + _RECORD_BYTES, _POINTER):
        if not may("w", address, 2 * _POINTER):
            return ""
        triple, name = text_at(address), text_at(address + _POINTER)
        if triple.startswith("x86_64-") and name in ("generic", target):
            if name == "generic":
                copy = ctypes.CDLL(None).strdup
                copy.restype = ctypes.c_void_p
                ctypes.c_uint64.from_address(address + _POINTER).value = copy(target.encode("ascii"))
            return target
    return ""
