"""What GPUs hold and how fast they are, from what their makers publish."""

from __future__ import annotations

from dataclasses import dataclass

WARP = 32
REGISTERS = 65536  # of a multiprocessor, of every architecture here


@dataclass(frozen=True)
class Multiprocessor:
    """What a multiprocessor of NVIDIA's holds: CUDA C++ Programming Guide, table of compute capabilities.

    Args:
        threads, blocks: at once.
        shared: bytes of shared memory.
        reserved: bytes of it that the system takes for each block.
    """

    threads: int
    blocks: int
    shared: int
    reserved: int


ARCHITECTURES = {
    75: Multiprocessor(1024, 16, 64 * 1024, 0),
    80: Multiprocessor(2048, 32, 164 * 1024, 1024),
    86: Multiprocessor(1536, 16, 100 * 1024, 1024),
    90: Multiprocessor(2048, 32, 228 * 1024, 1024),
    100: Multiprocessor(2048, 32, 228 * 1024, 1024),
    120: Multiprocessor(1536, 24, 100 * 1024, 1024),
}
# Waves that a SIMD of AMD's holds: the instruction set's reference guides.
WAVES = {"gfx90a": 8, "gfx1030": 16, "gfx1100": 16}


def occupancy(architecture: int, registers: int, shared: int, threads: int) -> float:
    """Share of a multiprocessor's threads that blocks of so many can take.

    Args:
        architecture: 75 and so on.
        registers: of a thread.
        shared: bytes of a block.
        threads: of a block.
    """
    held = ARCHITECTURES[architecture]
    warps = -(-threads // WARP)
    # A warp's registers come in lots of 256, a block's shared memory in lots of 128 bytes.
    of_warp = -(-max(registers, 1) * WARP // 256) * 256
    blocks = min(held.blocks, held.threads // threads, REGISTERS // of_warp // warps)
    of_block = -(-shared // 128) * 128 + held.reserved
    if of_block:
        blocks = min(blocks, held.shared // of_block)
    return blocks * warps * WARP / held.threads


@dataclass(frozen=True)
class Chip:
    """A GPU that the kernels' speed is bounded for.

    Args:
        name: in the table.
        source: whose figures.
        language: "warp" or "opencl", which form it would run.
        units: multiprocessors or compute units.
        clock: cycles a second, at boost.
        bandwidth: bytes a second of its memory.
        issue: operations of one lane that a unit starts in a cycle, of any kind.
        floats, integers: of numbers, and of whole numbers.
        words: of 32 bits that its shared memory passes in a cycle.
        words_issue: whether access to shared memory takes from the same issue.
    """

    name: str
    source: str
    language: str
    units: int
    clock: float
    bandwidth: float
    issue: int = 128
    floats: int = 128
    integers: int = 64
    words: int = 32
    words_issue: bool = True


# Operations in a cycle: CUDA C++ Programming Guide, throughput of native arithmetic instructions; AMD's CDNA 2 paper.
CHIPS = (
    Chip("H100 SXM5 80 GB", "NVIDIA H100 data sheet: 132 SMs, 1.98 GHz, 3.35 TB/s", "warp", 132, 1.98e9, 3.35e12),
    Chip("RTX 4090", "NVIDIA Ada paper: 128 SMs, 2.52 GHz, 1008 GB/s", "warp", 128, 2.52e9, 1.008e12),
    Chip(
        "MI250, one of its two dies",
        "AMD MI250 data sheet: 208 CUs, 1.7 GHz, 3.2 TB/s; a die is a device and has half",
        "opencl",
        104,
        1.7e9,
        1.6e12,
        issue=64,
        floats=64,
        integers=64,
        words_issue=False,
    ),
    Chip("RTX 4060 Laptop", "NVIDIA GeForce laptops page: 24 SMs, 2.37 GHz, 256 GB/s", "warp", 24, 2.37e9, 2.56e11),
)


def bound(chip: Chip, *, moved: float, words: float, floats: float, integers: float) -> tuple[float, str]:
    """How many cells or pixels a second a chip could do at most, and what holds it.

    Args:
        chip: which one.
        moved: bytes to and from its memory, for each cell or pixel.
        words: to and from shared memory.
        floats, integers: operations.
    """
    rate = chip.units * chip.clock
    issued = floats + integers + (words if chip.words_issue else 0.0)
    seconds = {
        "memory": moved / chip.bandwidth,
        "issue": issued / chip.issue / rate,
        "numbers": floats / chip.floats / rate,
        "whole numbers": integers / chip.integers / rate,
        "shared memory": words / chip.words / rate,
    }
    slowest = max(seconds, key=lambda name: seconds[name])
    return 1 / seconds[slowest], slowest
