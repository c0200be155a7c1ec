"""What PoCL needs to build kernels, and how PyPI's PoCL 3.0 gets to know processors newer than its LLVM 14.

PoCL asks LLVM for the processor's name. For one that LLVM does not know the answer is "generic", which clang
then refuses as a target ("unknown target CPU 'generic'", pocl issue 1049), so that PyPI's PoCL builds no kernel
on, for example, AMD's Zen 5. No option reaches that name. It lies in the driver's device record in this
process; writing a known older processor of the same seven letters over it mends the driver for this process.
"""

from __future__ import annotations

import ctypes
import shutil
from pathlib import Path

import pyopencl as cl

_UNKNOWN = b"generic\0"
# The newest processor that runs the same instructions and whose name is as long, by what the kernel reports.
_TARGETS = (("avx2", b"haswell\0"), ("sse4_2", b"nehalem\0"))
_RECORD_BYTES = 4096  # the name's address stands 640 bytes into the record of PoCL 3.0; others may differ


def obstacle(device: cl.Device) -> tuple[str, str]:
    """What keeps PoCL from building kernels here, and the command that would mend it; empty where nothing does.

    A processor that PoCL does not know is given a name on the way.
    """
    if device.platform.name != "Portable Computing Language":
        return "", ""
    if shutil.which("ld") is None:
        return "PoCL links each kernel with the linker ld, which is not installed", "apt-get install binutils"
    if device.version.endswith("x86_64-unknown-linux-gnu-generic") and not _name_processor(device):
        reason = "this PoCL does not know this processor and would refuse every kernel"
        return reason, "apt-get install pocl-opencl-icd, or use another OpenCL driver"
    return "", ""


def _name_processor(device: cl.Device) -> bool:
    """Give the device a processor that LLVM knows; False where the record is not as expected.

    Only memory that this process may write is read or written, and only a string that reads "generic".
    """
    try:
        flags = Path("/proc/cpuinfo").read_text("ascii", "replace").split()
        maps = [line.split() for line in Path("/proc/self/maps").read_text("utf-8").splitlines()]
    except OSError:
        return False
    target = next((name for flag, name in _TARGETS if flag in flags), None)
    spans = [tuple(int(end, 16) for end in m[0].split("-")) for m in maps if m[1].startswith("rw")]

    def writable(address: int) -> bool:
        return any(low <= address and address + 8 <= high for low, high in spans)

    for address in range(device.int_ptr, device.int_ptr + _RECORD_BYTES, 8):
        if target is None or not writable(address):
            return False
        name = ctypes.c_uint64.from_address(address).value
        if writable(name) and ctypes.string_at(name, len(_UNKNOWN)) in (_UNKNOWN, target):
            ctypes.memmove(name, target, len(target))
            return True
    return False
