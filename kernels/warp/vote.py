"""Fill mismatched pixels with what a cross of like colour around them agrees on."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MISMATCH = wp.constant(wp.uint8(8))
FILLED = wp.constant(wp.uint8(32))
PARTS = wp.constant(16.0)  # of a pixel, in which disparities are summed up: whole numbers, the same sum in any order


@wp.func
def arm(guide: wp.array(dtype=wp.uint8), size: int, pixel: int, by: int, most: int, alike: int):
    """How many samples of a line, `by` places apart, follow a pixel until one differs by `alike` in a channel."""
    red = int(guide[pixel])
    green = int(guide[size + pixel])
    blue = int(guide[2 * size + pixel])
    samples = int(0)
    at = int(pixel + by)
    while samples < most:
        if (
            wp.abs(int(guide[at]) - red) >= alike
            or wp.abs(int(guide[size + at]) - green) >= alike
            or wp.abs(int(guide[2 * size + at]) - blue) >= alike
        ):
            break
        samples += 1
        at += by
    return samples


@wp.func
def elected(
    disparity: wp.array(dtype=float),
    guide: wp.array(dtype=wp.uint8),
    x: int,
    y: int,
    width: int,
    height: int,
    reach: int,
    step: int,
    alike: int,
    least: int,
):
    """The mean of the whole disparity that more than half of the votes are for.

    NaN where there is none, or too few vote.
    """
    size = width * height
    pixel = y * width + x
    most_left = wp.min(reach, x) // step
    most_right = wp.min(reach, width - 1 - x) // step
    up = arm(guide, size, pixel, -step * width, wp.min(reach, y) // step, alike)
    down = arm(guide, size, pixel, step * width, wp.min(reach, height - 1 - y) // step, alike)
    votes = int(0)
    candidate = int(0)
    lead = int(0)
    backers = int(0)
    total = int(0)
    # The one that may have a majority is found without counts of all: each vote against it takes one for it away.
    for j in range(-up, down + 1):
        middle = pixel + j * step * width
        left = arm(guide, size, middle, -step, most_left, alike)
        right = arm(guide, size, middle, step, most_right, alike)
        for i in range(-left, right + 1):
            value = disparity[middle + i * step]
            if not wp.isnan(value):
                whole = int(wp.floor(value + 0.5))
                votes += 1
                if lead == 0:
                    candidate = whole
                if whole == candidate:
                    lead += 1
                else:
                    lead -= 1
    if votes < least or lead == 0:
        return wp.nan
    for j in range(-up, down + 1):
        middle = pixel + j * step * width
        left = arm(guide, size, middle, -step, most_left, alike)
        right = arm(guide, size, middle, step, most_right, alike)
        for i in range(-left, right + 1):
            value = disparity[middle + i * step]
            if not wp.isnan(value):
                if int(wp.floor(value + 0.5)) == candidate:
                    backers += 1
                    total += int(wp.floor(value * PARTS + 0.5))
    if 2 * backers <= votes:
        return wp.nan
    return float(total) / (PARTS * float(backers))


@wp.kernel
def vote(
    # In:
    disparity: wp.array(dtype=float),
    validity: wp.array(dtype=wp.uint8),
    guide: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    reach: int,
    step: int,
    alike: int,
    least: int,
    # Out:
    disparity_out: wp.array(dtype=float),
    validity_out: wp.array(dtype=wp.uint8),
):
    """Give a mismatched pixel the disparity that most pixels of like colour around it have; it carries FILLED too then.

    Every step-th pixel of a vertical arm of at most reach px votes with every step-th one of its own horizontal arms.
    An arm ends where the guide, (3, H, W), differs by alike or more from where it began. The whole disparity of more
    than half of at least `least` votes wins.

    Source: Zhang, Lu and Lafruit, "Cross-based local stereo matching", TCSVT 2009; voting as in Mei et al., "On
    building an accurate stereo matching system on graphics hardware", GPUCV 2011, section 3.4.
    """
    y, x = wp.tid()
    pixel = y * width + x
    value = float(disparity[pixel])
    reason = validity[pixel]
    if wp.isnan(value) and (reason & MISMATCH) != wp.uint8(0):
        value = elected(disparity, guide, x, y, width, height, reach, step, alike, least)
        if not wp.isnan(value):
            reason = reason | FILLED
    disparity_out[pixel] = value
    validity_out[pixel] = reason
