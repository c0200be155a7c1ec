"""Compile the kernels for GPUs that need not be here, and read what the compilers say of them."""

from __future__ import annotations

import importlib
import importlib.metadata
import json
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gpu_chips import ARCHITECTURES, WAVES, occupancy

import stereo_gpu.kernels as kernels
from stereo_gpu.kernels.geometry import geometry
from stereo_gpu.kernels.opencl import source

FOLDER = Path(kernels.__file__).parent
KERNELS = sorted(path.stem for path in (FOLDER / "opencl").glob("*.cl") if not path.stem.endswith("_cpu"))
BUILTINS = Path("/usr/lib/clc/amdgcn--amdhsa.bc")  # libclc: OpenCL's built-in functions, for AMD
CLANGS = ("clang-16", "clang-17", "clang-18", "clang-19", "clang-15", "clang-14")
THREADS = 256  # of a block whose kernel does not say; Warp's own choice
# Sizes that the report is for, and what else a launch asks.
WIDTH, HEIGHT, DISPARITIES, WINDOW = 1280, 960, 128, 11
ARGUMENTS = {
    "width": WIDTH,
    "height": HEIGHT,
    "disparities": DISPARITIES,
    "radius": WINDOW // 2,
    "heading": 1,
    "triangles": 1,
    "texture_width": 1,
    "texture_height": 1,
    "cell": 4,
    "side": 2,
    "diagonal": 1,
    "planes_wide": WIDTH // 8,
    "planes_high": HEIGHT // 8,
}


@dataclass(frozen=True)
class Compiled:
    """What a compiler made of a kernel.

    Args:
        kernel, architecture: such as "median" and "sm_90".
        registers: of a thread.
        spilled: bytes of a thread's own memory, where what finds no register goes.
        shared: bytes of a block's shared memory.
        occupancy: share of the threads that a multiprocessor can hold.
        calls: of functions that were not there to be compiled.
    """

    kernel: str
    architecture: str
    registers: int
    spilled: int
    shared: int
    occupancy: float
    calls: int = 0


def find_ptxas() -> str:
    """NVIDIA's assembler from PyPI, which the tool installs: one of another toolkit may be too old for Warp's PTX.

    Raises:
        FileNotFoundError: it is not installed.
    """
    try:
        files = importlib.metadata.files("nvidia-cuda-nvcc") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    found = next((str(file.locate()) for file in files if file.name == "ptxas"), "")
    if not found:
        raise FileNotFoundError("no ptxas: pip install -e '.[gpu-report]'")
    return found


def compile_for_cuda(kernel: str) -> list[Compiled]:
    """Compile a Warp kernel to PTX for every architecture, and that to machine code.

    Raises:
        RuntimeError: the assembler refuses it; the message is its own.
    """
    import warp as wp

    from stereo_gpu.backends import open_backend

    open_backend("warp:cpu")  # starts Warp without its banner
    program: Any = importlib.import_module(f"stereo_gpu.kernels.warp.{kernel}")
    entry = getattr(program, kernel)
    if entry.is_generic:
        for pixel in (wp.uint8, wp.uint16):
            wp.overload(entry, [_concrete(wp, parameter, pixel) for parameter in entry.adj.args])
    plan = geometry(kernel, "warp", "gpu", ARGUMENTS, 132)
    threads = plan.group or THREADS
    wp.set_module_options({"block_dim": threads}, program)
    with tempfile.TemporaryDirectory() as folder:
        wp.compile_aot_module(program, arch=list(ARCHITECTURES), module_dir=folder, use_ptx=True)
        tiles = max([0, *(max(json.loads(m.read_text()).values()) for m in Path(folder).glob("*.meta"))])
        return [_assemble(kernel, a, next(Path(folder).glob(f"*.sm{a}.ptx")), threads, tiles) for a in ARCHITECTURES]


def _concrete(wp: Any, parameter: Any, pixel: Any) -> Any:
    """The type of a parameter, with `pixel` for the elements of pictures of any type."""
    return wp.array(dtype=pixel) if getattr(parameter.type, "dtype", None) is Any else parameter.type


def _assemble(kernel: str, architecture: int, file: Path, threads: int, tiles: int) -> Compiled:
    # Warp ends the text with a NUL, which the assembler does not take.
    file.write_bytes(file.read_bytes().rstrip(b"\0"))
    command = [find_ptxas(), "-v", f"-arch=sm_{architecture}", str(file), "-o", f"{file}.cubin"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{kernel} for sm_{architecture}: {(done.stdout + done.stderr).strip()}")
    text = done.stdout + done.stderr
    registers = max(int(n) for n in re.findall(r"Used (\d+) registers", text))
    stack = max(int(n) for n in re.findall(r"(\d+) bytes stack frame", text))
    shared = max([0, *(int(n) for n in re.findall(r"(\d+) bytes smem", text))]) + tiles
    share = occupancy(architecture, registers, shared, threads)
    return Compiled(kernel, f"sm_{architecture}", registers, stack, shared, share)


def find_clang() -> str:
    """A clang that compiles OpenCL for AMD.

    Raises:
        FileNotFoundError: there is none, or OpenCL's built-in functions are missing.
    """
    found = next((path for name in CLANGS if (path := shutil.which(name))), None)
    if found is None or not BUILTINS.exists():
        raise FileNotFoundError("no clang with libclc: apt-get install clang-16 libclc-16")
    return found


def compile_for_amd(kernel: str) -> list[Compiled]:
    """Compile an OpenCL kernel for every AMD architecture.

    Raises:
        RuntimeError: the compiler refuses it; the message is its own.
    """
    clang = find_clang()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        text, assembly = Path(folder) / f"{kernel}.cl", Path(folder) / f"{kernel}.s"
        # libclc leaves the square root to the compiler, as AMD's own library does.
        text.write_text("#define sqrt __builtin_sqrtf\n" + source(kernel), "utf-8")
        for architecture, waves in WAVES.items():
            command = [clang, "-x", "cl", "-cl-std=CL1.2", "-target", "amdgcn-amd-amdhsa", f"-mcpu={architecture}"]
            command += ["-nogpulib", "-O3", "-S", "-DPIXEL=ushort", "-Xclang", "-finclude-default-header"]
            command += ["-Xclang", "-mlink-builtin-bitcode", "-Xclang", str(BUILTINS), "-Wno-linker-warnings"]
            done = subprocess.run([*command, str(text), "-o", str(assembly)], capture_output=True, text=True)
            if done.returncode:
                raise RuntimeError(f"{kernel} for {architecture}: {done.stderr.strip()}")
            found.append(_read_assembly(kernel, architecture, waves, assembly.read_text("utf-8")))
    return found


def _read_assembly(kernel: str, architecture: str, waves: int, text: str) -> Compiled:
    # The kernel's own block of figures: functions that it calls come before it and have their own.
    body = text[text.rindex("; Kernel info:") :]
    figures = {name: int(number) for name, number in re.findall(r"^; (\w+): (\d+)", body, re.MULTILINE)}
    return Compiled(
        kernel,
        architecture,
        figures["NumVgprs"],
        figures["ScratchSize"],
        figures["LDSByteSize"],
        figures["Occupancy"] / waves,
        len(re.findall(r"\bs_swappc_b64\b", text)),
    )
