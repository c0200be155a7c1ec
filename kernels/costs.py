"""What the forms for GPUs of the hot kernels take, counted from their text: tools/gpu_report bounds their speed by it.

Counts are for each cell (pixel and disparity) or pixel. Bytes pass to or from the device's memory, each value once
where a cache can be trusted to hold it; words of 32 bits pass to or from shared (local) memory; operations are those of
one lane, loops and addresses included as far as compilers leave them. The machine code of ncc_wta for sm_90 has about
45 instructions a cell at window 11, 128 disparities and long strips, of which the formulas count 40.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Cost:
    """Work for each cell or pixel.

    Args:
        per: "cell" or "pixel".
        bytes: to and from the device's memory.
        words: to and from shared memory.
        floats: operations on numbers.
        integers: operations on whole numbers, comparisons, conversions and selections.
    """

    per: str
    bytes: float
    words: float
    floats: float
    integers: float


def cost(kernel: str, language: str, disparities: int, window: int, rows: int) -> Cost:
    """Count the work of a hot kernel.

    Args:
        kernel: its name.
        language: "warp" or "opencl", whose forms own 16 and 8 columns a group.
        disparities: how many are searched.
        window: side of the window, px.
        rows: of the strips that ncc_wta takes.

    Raises:
        KeyError: the kernel is none of the hot ones.
    """
    columns, group = (16, 128) if language == "warp" else (8, 64)
    chunks = -(-disparities // group)
    return {
        "ncc_wta": _ncc_wta(columns, group, chunks, disparities, window, rows),
        # A row of the window enters and one leaves: two products each, from the cache. The score goes out.
        "ncc_volume": Cost("cell", 4.0 + 28 / disparities, 4.0 * window, 4.0 * window + 6, 12.0 * window + 12),
        # The score, its key to shared memory and back twice; of a pixel the search's end.
        "wta": Cost("cell", 4.0 + 22 / disparities, 3.2, 1.0, 18.0),
        # Bits, three colours and validity of two pixels; the ones, three distances and the two parabolas.
        "match_cost": Cost("cell", 1.0 + 16 / disparities, 0.0, 0.0, 48.0),
        # All 8 paths of three headings: a byte of cost, the sum in and out, but for the first path, which sets it;
        # three paths in, one out.
        "aggregate": Cost("cell", 38.0, 8 * 4.5, 0.0, 8 * 34.0),
        # A sum, its key, the two lowest of a class; of a pixel 16 keys to shared memory and back twice.
        "lowest": Cost("cell", 2.0 + 14 / disparities, 48 / disparities, 0.0, 9.0 + 110 / disparities),
        # 25 samples, each with its place, both rises, the difference, its weight and six sums; the step's end.
        "evidence": Cost("pixel", 35.0, 0.0, 25 * 36 + 40, 25 * 28 + 20),
        # A count of the neighbours, and about three steps to the middle.
        "median": Cost("pixel", 8.0, 0.0, 0.0, 25 * 6 + 3 * 25 * 7),
    }[kernel]


def _ncc_wta(columns: int, group: int, chunks: int, disparities: int, window: int, rows: int) -> Cost:
    # The window's own width enters before the first column of each row; then a product enters and one leaves. The
    # rows above the strip that its first window holds are summed up for nothing else.
    products = (window - 1 + 2 * columns) / columns * (1 + (window - 1) / rows)
    # Of pictures and windows a row of our columns and one of the other view's, whose columns overlap.
    staged = (2 * (columns + window - 1) + 2 * columns + 4 * (group + columns) + 2 * (window - 1)) / (columns * group)
    padding = chunks * group / disparities  # work-items beyond the last disparity idle along
    pixel = 24 + 1 + 17 + 8 + chunks * 56  # pictures and windows, validity, results, the other view, the record
    return Cost(
        "cell",
        pixel / disparities,
        # Theirs and, four at a time, ours; the window's four values, two of them four at a time; keys out and in twice.
        (1.25 * products + 2.5 + 3.2 + staged) * padding,
        4.0 * padding,
        # A product, its place in the box, the key, two highest of ours and one of theirs; staging; the search's end;
        # loops and addresses.
        (products + 1 + 6 + 5 + 6 * staged + 3 + 7) * padding,
    )
