"""Correlation and winner takes all in one pass that never holds the volume: the form for GPUs.

A block owns SPAN columns over a strip of rows, a thread one disparity of each of them. Rows of both pictures lie
in shared memory; the box sums stay in registers and run down the strip: each row adds what the row that enters the
window brings and the one that leaves it takes, summed along the row. The keys of a row pass through shared memory,
where the threads look for the winners of both views. Longer ranges than GROUP are searched a chunk after another;
what is known of each pixel waits in scratch meanwhile.
"""

import warp as wp

from stereo_gpu.kernels.warp.block import add_pair_product, barrier, load, store
from stereo_gpu.kernels.warp.block_winners import (
    CLASSES,
    GROUP,
    HIGHEST,
    KEYS,
    PITCH,
    SECONDS,
    SPAN,
    get,
    get_float,
    highest_four,
    put,
    put_float,
    raise_winners,
    runner_level,
    search_column,
)
from stereo_gpu.kernels.warp.peaks import (
    OUT_OF_RANGE,
    Peaks,
    index_bits,
    key_index,
    no_peaks,
    peak_disparity,
    score_scale,
    winner_key,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Where in shared memory lie
OURS = wp.constant(2688)  # grey levels of our rows that enter and leave the window: SPAN and twice the largest radius
THEIRS = wp.constant(2734)  # the same of the other view, from the smallest u on: GROUP + SPAN and as many
MEANS = wp.constant(2908)  # of our windows,
INVERSES = wp.constant(2924)  # and their inverse norms times the levels of a score of 1
THEIR_SUMS = wp.constant(2940)  # of the other view's windows, GROUP + SPAN,
THEIR_INVERSES = wp.constant(3084)
WIDTH = wp.constant(3228)  # of the picture
FIRST = wp.constant(3229)  # row of the strip
Boxes = wp.types.vector(length=16, dtype=wp.int32)


@wp.func
def put_theirs(k: int, u0: int, other: wp.array(dtype=float), entering: int, leaving: int, width: int):
    """Write what enters and leaves the window at column u0 + k of the other view to shared memory."""
    u = wp.clamp(u0 + k, 0, width - 1)
    put(THEIRS + k, (int(load(other, entering + u)) & 255) | (int(load(other, leaving + u)) << 8))


@wp.func
def put_their_window(
    k: int, u0: int, sums: wp.array(dtype=float), inverses: wp.array(dtype=float), row: int, width: int
):
    """Write sum and inverse norm of the other view's window at column u0 + k to shared memory; 0 outside of it."""
    total = float(0.0)
    inverse = float(0.0)
    if u0 + k >= 0 and u0 + k < width:
        total = load(sums, row + u0 + k)
        inverse = load(inverses, row + u0 + k)
    put_float(THEIR_SUMS + k, total)
    put_float(THEIR_INVERSES + k, inverse)


@wp.func
def hold(scratch: wp.array(dtype=float), at: int, pixels: int, peaks: Peaks):
    """Let peaks wait in scratch, a plane of it for each member; floats hold levels and indices, which have 23 bits."""
    store(scratch, at, float(peaks.best))
    store(scratch, at + pixels, float(peaks.index))
    store(scratch, at + 2 * pixels, float(peaks.before))
    store(scratch, at + 3 * pixels, float(peaks.after))
    store(scratch, at + 4 * pixels, float(peaks.runner))
    store(scratch, at + 5 * pixels, float(peaks.last))
    store(scratch, at + 6 * pixels, float(peaks.earlier))


@wp.func
def held(scratch: wp.array(dtype=float), at: int, pixels: int) -> Peaks:
    """What scratch says of the winner."""
    peaks = Peaks()
    peaks.best = int(load(scratch, at))
    peaks.index = int(load(scratch, at + pixels))
    peaks.before = int(load(scratch, at + 2 * pixels))
    peaks.after = int(load(scratch, at + 3 * pixels))
    peaks.runner = int(load(scratch, at + 4 * pixels))
    return peaks


@wp.func
def joined(
    scratch: wp.array(dtype=float), at: int, pixels: int, peaks: Peaks, start: int, first: int, later: int
) -> Peaks:
    """The peaks that wait in scratch and those of the next chunk, which begins at index start with the level first.

    later is the highest level of the chunk but that one.
    """
    best = int(load(scratch, at))
    if peaks.best > best:
        beyond = best
        if peaks.index == start:
            peaks.before = int(load(scratch, at + 5 * pixels))
            beyond = int(load(scratch, at + 6 * pixels))
        peaks.runner = wp.max(peaks.runner, beyond)
    else:
        beyond = peaks.best
        peaks.index = int(load(scratch, at + pixels))
        peaks.before = int(load(scratch, at + 2 * pixels))
        if peaks.index == start - 1:
            peaks.after = first
            beyond = later
        else:
            peaks.after = int(load(scratch, at + 3 * pixels))
        peaks.runner = wp.max(int(load(scratch, at + 4 * pixels)), beyond)
        peaks.best = best
    peaks.earlier = wp.max(peaks.earlier, best)
    return peaks


@wp.func
def peaks_of(four: wp.vec4i, column: int, start: int, end: int, direction: int, bits: int) -> Peaks:
    """The peaks among disparities start to end - 1, whose keys begin at column, or end there."""
    peaks = no_peaks()
    at = key_index(four[0], bits)
    peaks.last = get(column + direction * (end - 1 - start)) >> bits
    peaks.earlier = level_but(four, end - 1, bits)
    if four[0] > 0:
        peaks.best = four[0] >> bits
        peaks.index = at
        if at > start:
            peaks.before = get(column + direction * (at - 1 - start)) >> bits
        if at < end - 1:
            peaks.after = get(column + direction * (at + 1 - start)) >> bits
        peaks.runner = runner_level(four, bits)
    return peaks


@wp.func
def level_but(four: wp.vec4i, index: int, bits: int) -> int:
    """The highest level but that of a disparity."""
    return wp.where(key_index(four[0], bits) == index, four[1], four[0]) >> bits


# Eight blocks a multiprocessor, which 64 registers a thread allow.
@wp.kernel(launch_bounds=(128, 8), grid_stride=False)
def ncc_wta(
    # In:
    reference: wp.array(dtype=float),
    other: wp.array(dtype=float),
    reference_sum: wp.array(dtype=float),
    reference_inverse: wp.array(dtype=float),
    other_sum: wp.array(dtype=float),
    other_inverse: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    radius: int,
    direction: int,
    subpixel: int,
    rows: int,
    scratch: wp.array(dtype=float),
    # Out:
    disparity_out: wp.array(dtype=float),
    score_out: wp.array(dtype=float),
    ratio_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
    other_out: wp.array(dtype=int),
):
    """What ncc_volume followed by wta computes, without the volume; other_out must come in as 0."""
    block, lane = wp.tid()
    tiles = (width + SPAN - 1) // SPAN
    x = (block % tiles) * SPAN + lane
    count = float((2 * radius + 1) * (2 * radius + 1))
    bits = index_bits(disparities)
    for k in range(lane, SPAN * PITCH, GROUP):
        put(KEYS + k, 0)
    if lane == 0:
        put(WIDTH, width)
        put(FIRST, (block // tiles) * rows)
    barrier()

    for start in range(0, disparities, GROUP):
        first = get(FIRST)
        last = wp.min(first + rows, height)
        end = wp.min(start + GROUP, disparities)
        # Threads of larger u come later.
        i = start + wp.where(direction < 0, GROUP - 1 - lane, lane)
        u0 = x - lane + direction * (smallest + start) + wp.min(direction, 0) * (GROUP - 1)
        box = Boxes()

        for y in range(first - 2 * radius, last):
            # Read anew in every row, so that no register keeps what follows from them: there are too few.
            wide = get(WIDTH)
            first = get(FIRST)
            row = y * wide
            entering = wp.clamp(y + radius, 0, height - 1) * wide
            # The row that left the window when it moved down to y; before the first row nothing has.
            leaving = wp.clamp(y - radius - 1, 0, height - 1) * wide

            if lane < SPAN + 2 * radius:
                at = wp.clamp(x - radius, 0, wide - 1)
                gone = int(0)
                if y > first:
                    gone = -int(load(reference, leaving + at))
                put(OURS + lane, (int(load(reference, entering + at)) & 65535) | (gone << 16))
            put_theirs(lane, u0 - radius, other, entering, leaving, wide)
            if lane < SPAN + 2 * radius:
                put_theirs(lane + GROUP, u0 - radius, other, entering, leaving, wide)
            if y >= first:
                if lane < SPAN:
                    mean = float(0.0)
                    inverse = float(0.0)
                    if x < wide:
                        mean = load(reference_sum, row + x) / count
                        inverse = load(reference_inverse, row + x)
                    put_float(MEANS + lane, mean)
                    # Scaled by a power of two, which changes no digit, so that scores come in levels.
                    put_float(INVERSES + lane, inverse * score_scale(bits))
                put_their_window(lane, u0, other_sum, other_inverse, row, wide)
                if lane < SPAN:
                    put_their_window(lane + GROUP, u0, other_sum, other_inverse, row, wide)
            barrier()

            change = int(0)  # of the box sum
            for k in range(2 * radius):
                change = add_pair_product(change, get(OURS + k), get(THEIRS + lane + k))
            right = 2 * radius
            for s in range(SPAN):
                change = add_pair_product(change, get(OURS + right + s), get(THEIRS + lane + right + s))
                box[s] += change
                change -= add_pair_product(0, get(OURS + s), get(THEIRS + lane + s))
            if y < first:
                # All must have read the rows before the next ones come.
                barrier()
            else:
                for s in range(SPAN):
                    # This order of operations is the same in every form of the correlation, so that all agree.
                    score = (
                        (float(box[s]) - get_float(MEANS + s) * get_float(THEIR_SUMS + lane + s))
                        * get_float(INVERSES + s)
                    ) * get_float(THEIR_INVERSES + lane + s)
                    level = int(score)
                    key = wp.where(level > 0 and i < disparities, winner_key(level, i, bits), 0)
                    put(KEYS + lane + s * PITCH, key)
                barrier()

                two = search_column(wp.vec2i(), lane)
                put(HIGHEST + lane, two[0])
                put(SECONDS + lane, two[1])
                raise_winners(other_out, row, u0, lane, wide)
                barrier()

                if lane < SPAN and x < wide:
                    pixel = row + x
                    four = highest_four(lane)
                    column = KEYS + lane * PITCH + wp.where(direction < 0, GROUP - 1, 0)
                    peaks = peaks_of(four, column, start, end, direction, bits)
                    if start > 0:
                        later = level_but(four, start, bits)
                        peaks = joined(scratch, pixel, wide * height, peaks, start, get(column) >> bits, later)
                    hold(scratch, pixel, wide * height, peaks)

    # All that wait in scratch are there.
    barrier()
    x -= lane & ~(SPAN - 1)
    if x < width:
        first = get(FIRST)
        for y in range(first + (lane >> 4), wp.min(first + rows, height), CLASSES):
            pixel = y * width + x
            peaks = held(scratch, pixel, width * height)
            store(score_out, pixel, float(peaks.best) / score_scale(bits))
            store(disparity_out, pixel, wp.nan)
            store(ratio_out, pixel, 0.0)
            validity_out[pixel] = validity[pixel]
            if peaks.best > 0:
                store(disparity_out, pixel, peak_disparity(peaks, smallest, subpixel))
                store(ratio_out, pixel, float(peaks.runner) / float(peaks.best))
            elif validity[pixel] == wp.uint8(0):
                validity_out[pixel] = wp.uint8(OUT_OF_RANGE)
