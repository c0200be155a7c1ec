"""What every kernel must compute, in plain loops that anyone can check against the formula."""

import math

import numpy as np

OUT_OF_RANGE, TEXTURELESS, OCCLUDED, MISMATCH, MASKED, FILLED = 1, 2, 4, 8, 16, 32


def clamp(index, size):
    return min(max(index, 0), size - 1)


def grey(picture, black, scale):
    """Rec. 601 luma above black times scale, rounded to whole grey levels, minus 128."""
    height, width = picture.shape[:2]
    out = np.empty((height, width))
    for y in range(height):
        for x in range(width):
            pixel = picture[y, x]
            luma = float(pixel) if picture.ndim == 2 else 0.299 * pixel[0] + 0.587 * pixel[1] + 0.114 * pixel[2]
            out[y, x] = math.floor(min(max((luma - black) * scale, 0.0), 255.0) + 0.5) - 128
    return out


def smooth(source, weights):
    """Gaussian along x, then along y, the edge repeated, rounded at the end."""
    height, width = source.shape
    radius = len(weights) // 2
    across, out = np.zeros((height, width)), np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            across[y, x] = sum(w * source[y, clamp(x + i - radius, width)] for i, w in enumerate(weights))
    for y in range(height):
        for x in range(width):
            total = sum(w * across[clamp(y + i - radius, height), x] for i, w in enumerate(weights))
            out[y, x] = math.floor(total + 0.5)
    return out


def window(picture, x, y, radius):
    """The (2 radius + 1) squared pixels around (x, y), the edge repeated."""
    height, width = picture.shape
    return [
        float(picture[clamp(y + j, height), clamp(x + i, width)])
        for j in range(-radius, radius + 1)
        for i in range(-radius, radius + 1)
    ]


def window_norms(picture, mask, radius, threshold):
    """Sum, inverse norm of the zero-mean window, and validity of every pixel."""
    height, width = picture.shape
    sums, inverses = np.zeros((height, width)), np.zeros((height, width))
    validity = np.zeros((height, width), np.uint8)
    for y in range(height):
        for x in range(width):
            values = window(picture, x, y, radius)
            mean = sum(values) / len(values)
            norm = math.sqrt(sum((v - mean) ** 2 for v in values))
            sums[y, x] = sum(values)
            if not mask[y, x]:
                validity[y, x] = MASKED
            elif norm <= threshold:
                validity[y, x] = TEXTURELESS
            else:
                inverses[y, x] = 1 / norm
    return sums, inverses, validity


def ncc(a, b):
    """Zero-mean normalized cross-correlation of two windows; None where one is flat."""
    mean_a, mean_b = sum(a) / len(a), sum(b) / len(b)
    norm = math.sqrt(sum((v - mean_a) ** 2 for v in a)) * math.sqrt(sum((v - mean_b) ** 2 for v in b))
    return sum((p - mean_a) * (q - mean_b) for p, q in zip(a, b, strict=True)) / norm if norm else None


def ncc_volume(reference, other, validity_reference, validity_other, smallest, disparities, radius, direction):
    """NCC of reference(x, y) with other(x + direction d, y) where both are good; 0 elsewhere."""
    height, width = reference.shape
    volume = np.zeros((height, width, disparities))
    for y in range(height):
        windows = [window(other, u, y, radius) for u in range(width)]
        for x in range(width):
            mine = window(reference, x, y, radius)
            for i in range(disparities):
                u = x + direction * (smallest + i)
                if 0 <= u < width and not validity_reference[y, x] and not validity_other[y, u]:
                    volume[y, x, i] = ncc(mine, windows[u])
    return volume


def levels_of(disparities):
    """Levels of a score of 1: 30 bits hold the level and the disparity's index, the index at least 7 of them."""
    return 2 ** (30 - max(7, (disparities - 1).bit_length()))


def wta(volume, validity, smallest, direction, subpixel):
    """Disparity, score, ratio of runner-up to best, validity, and the other view's winner (-1: none).

    Scores count in whole levels. The runner-up is the highest level more than one disparity away from the best.
    """
    height, width, disparities = volume.shape
    levels = levels_of(disparities)
    disparity = np.full((height, width), np.nan)
    score, ratio = np.zeros((height, width)), np.zeros((height, width))
    out = validity.copy()
    other = np.full((height, width), -1)
    for y in range(height):
        best_of = [0] * width
        for x in range(width):
            row = [max(0, math.floor(s * levels)) for s in volume[y, x]]
            best = max(row)
            for i in range(disparities):
                u = x + direction * (smallest + i)
                if row[i] <= 0:
                    continue
                # Of equal levels the smaller disparity wins.
                if row[i] > best_of[u] or (row[i] == best_of[u] and i < other[y, u]):
                    best_of[u], other[y, u] = row[i], i
            if best == 0:
                out[y, x] = validity[y, x] or OUT_OF_RANGE
                continue
            index = row.index(best)
            out[y, x] = 0
            before = row[index - 1] if index > 0 else 0
            after = row[index + 1] if index < disparities - 1 else 0
            disparity[y, x] = smallest + index
            if subpixel and before > 0 and after > 0:
                disparity[y, x] += 0.5 * (before - after) / (before - 2 * best + after)
            score[y, x] = best / levels
            ratio[y, x] = max((row[i] for i in range(disparities) if abs(i - index) > 1), default=0) / best
    return disparity, score, ratio, out, other


def certainty(ratio, validity, doubt):
    """The less the closer the runner-up comes; 0 where the pixel is not good."""
    out = np.zeros(ratio.shape, np.float32)
    for y, x in np.ndindex(*ratio.shape):
        if validity[y, x] == 0:
            out[y, x] = 1 - doubt * (ratio[y, x] ** 3 if ratio[y, x] < 1 else 1)
    return out


def confidence(score, ratio, validity, weight):
    """The score within 0..1, less the closer the runner-up comes to it; 0 where the pixel is not good."""
    out = np.zeros(score.shape)
    for y, x in np.ndindex(score.shape):
        if validity[y, x] == 0:
            out[y, x] = min(max(score[y, x] * (1 - weight * ratio[y, x]), 0), 1)
    return out


def masked(mask):
    """MASKED where the mask is 0, else 0."""
    return np.where(mask == 0, MASKED, 0)


def consistency(disparity, other, validity, smallest, disparities, direction, tolerance):
    """Left-right check; other holds the index of the other view's winner, -1 for none."""
    height, width = disparity.shape
    values, out = disparity.copy(), validity.copy()
    for y in range(height):
        for x in range(width):
            d = disparity[y, x]
            if math.isnan(d):
                continue
            u = x + direction * math.floor(d + 0.5)
            if u < -1 or u > width:
                values[y, x], out[y, x] = math.nan, OCCLUDED
                continue
            back = other[y, clamp(u, width)]
            if back >= 0 and abs(smallest + back - d) <= tolerance:
                continue
            agrees = False
            for i in range(disparities):
                u = x + direction * (smallest + i)
                agrees = agrees or (0 <= u < width and other[y, u] == i)
            values[y, x] = math.nan
            out[y, x] = MISMATCH if agrees else OCCLUDED
    return values, out


def agree(disparity, validity, other_disparity, smallest, disparities, direction, tolerance):
    """Left-right check of two maps; OCCLUDED if the other view sees no point on the ray, else MISMATCH."""
    height, width = disparity.shape
    values, out = disparity.copy(), validity.copy()
    for y, x in np.ndindex(height, width):
        d = disparity[y, x]
        if math.isnan(d):
            continue
        u = x + direction * math.floor(d + 0.5)
        if 0 <= u < width and abs(other_disparity[y, u] - d) <= tolerance:
            continue
        values[y, x], out[y, x] = math.nan, OCCLUDED
        for k in range(smallest, smallest + disparities):
            u = x + direction * k
            if 0 <= u < width and abs(other_disparity[y, u] - k) <= tolerance:
                out[y, x] = MISMATCH
    return values, out


def median(disparity, size):
    """Lower median of the neighbours that have a value; a pixel without stays without."""
    height, width = disparity.shape
    out = disparity.copy()
    for y in range(height):
        for x in range(width):
            if math.isnan(disparity[y, x]):
                continue
            around = disparity[max(0, y - size // 2) : y + size // 2 + 1, max(0, x - size // 2) : x + size // 2 + 1]
            values = sorted(v for v in around.flat if not math.isnan(v))
            out[y, x] = values[(len(values) - 1) // 2]
    return out


def support(disparity, validity, reach, step, tolerance, slope, share):
    """Keep values that at least share of the pixels on a grid around them have."""
    height, width = disparity.shape
    values, out = disparity.copy(), validity.copy()
    offsets = range(-(reach // step) * step, reach + 1, step)
    for y in range(height):
        for x in range(width):
            if math.isnan(disparity[y, x]):
                continue
            agreeing = 0
            for j in offsets:
                for i in offsets:
                    if 0 <= y + j < height and 0 <= x + i < width:
                        allowed = tolerance + slope * max(abs(i), abs(j))
                        agreeing += abs(disparity[y + j, x + i] - disparity[y, x]) <= allowed
            if agreeing < share * len(offsets) ** 2:
                values[y, x] = math.nan
                out[y, x] = MISMATCH
    return values, out


def vote(disparity, validity, guide, reach, step, alike, least):
    """Mismatched pixels take the whole disparity that most of their cross of like colour have; slowly, by counting."""
    height, width = disparity.shape
    values, out, colours = disparity.copy(), validity.copy(), guide.astype(int)

    def arm(x, y, dx, dy):
        """The place itself, and those that follow it in one direction."""
        places = [(x, y)]
        for k in range(step, reach + 1, step):
            u, v = x + k * dx, y + k * dy
            inside = 0 <= u < width and 0 <= v < height
            if not inside or np.abs(colours[:, v, u] - colours[:, y, x]).max() >= alike:
                break
            places.append((u, v))
        return places

    def both_arms(x, y, dx, dy):
        return arm(x, y, -dx, -dy)[:0:-1] + arm(x, y, dx, dy)

    for y, x in zip(*np.nonzero(np.isnan(disparity) & (validity & MISMATCH != 0)), strict=True):
        support = [place for above in both_arms(x, y, 0, 1) for place in both_arms(*above, 1, 0)]
        votes = [float(disparity[v, u]) for u, v in support if not math.isnan(disparity[v, u])]
        whole = [math.floor(value + 0.5) for value in votes]
        if len(votes) < max(least, 1):
            continue
        winner = max(set(whole), key=whole.count)
        backers = [value for value, at in zip(votes, whole, strict=True) if at == winner]
        if 2 * len(backers) > len(votes):
            values[y, x] = sum(math.floor(value * 16 + 0.5) for value in backers) / (16 * len(backers))
            out[y, x] |= FILLED
    return values, out


def likeness(guide, x, y, u, v):
    """(1 - s / 240)^8, s being the sum over three planes of |difference| of two pixels; 0 from 240 on."""
    s = int(np.abs(guide[:, y, x].astype(int) - guide[:, v, u]).sum())
    return max(0.0, 1 - s / 240) ** 8


def on_grid(shape, validity, x, y, reach, step):
    """Offsets of the pixels around (x, y), every step-th within reach, that are in the picture and not masked."""
    offsets = range(-(reach // step) * step, reach + 1, step)
    around = [(i, j) for j in offsets for i in offsets if 0 <= y + j < shape[0] and 0 <= x + i < shape[1]]
    return [(i, j) for i, j in around if not validity[y + j, x + i] & MASKED]


def guided_support(disparity, validity, guide, reach, step, tolerance, slope, share):
    """Keep values that at least share of what looks alike around them has; a hole counts a quarter, against them."""
    values, out = disparity.copy(), validity.copy()
    for y, x in np.ndindex(disparity.shape):
        if math.isnan(disparity[y, x]) or validity[y, x] & MASKED:
            continue
        total = agreeing = 0.0
        for i, j in on_grid(disparity.shape, validity, x, y, reach, step):
            weight = likeness(guide, x, y, x + i, y + j)
            apart = abs(disparity[y + j, x + i] - disparity[y, x])
            total += weight * (0.25 if math.isnan(apart) else 1)
            agreeing += weight * (apart <= tolerance + slope * max(abs(i), abs(j)))
        if agreeing < share * total:
            values[y, x] = math.nan
            out[y, x] |= MISMATCH
    return values, out


def plane_fit(disparity, validity, guide, reach, step, tolerance, slope, largest_slope):
    """Weighted least squares for v = c + a dx + b dy, where a and b have a prior of weight n / 2 to be 0; twice."""
    out = disparity.copy()
    for y, x in np.ndindex(disparity.shape):
        if math.isnan(disparity[y, x]) or validity[y, x] & MASKED:
            continue
        c = a = b = 0.0
        for grows in (slope, 0.0):
            rows = []
            for i, j in on_grid(disparity.shape, validity, x, y, reach, step):
                v = disparity[y + j, x + i] - disparity[y, x]
                u = (v - c - a * i - b * j) / (tolerance + grows * max(abs(i), abs(j)))
                if abs(u) < 1:
                    rows.append((likeness(guide, x, y, x + i, y + j) * (1 - u * u) ** 2, i, j, v))
            w, i, j, v = np.array(rows).reshape(-1, 4).T
            if w.sum() < 3:
                break
            means = [(w * t).sum() / w.sum() for t in (i, j, v)]
            design = np.sqrt(w)[:, None] * np.column_stack([i - means[0], j - means[1]])
            design = np.vstack([design, math.sqrt(w.sum() / 2) * np.eye(2)])
            slopes = np.linalg.lstsq(design, np.concatenate([np.sqrt(w) * (v - means[2]), [0, 0]]), rcond=None)[0]
            a, b = np.where(np.abs(slopes) <= largest_slope, slopes, 0)
            c = means[2] - a * means[0] - b * means[1]
        if abs(c) <= tolerance:
            out[y, x] = disparity[y, x] + c
    return out


def slopes(disparity, reach, largest):
    """Change a pixel along x and along y: the mean of both sides, or the gentler one where they differ by over 0.5."""
    out = np.zeros((2, *disparity.shape))
    for y, x in np.ndindex(disparity.shape):
        for axis, (i, j) in enumerate(((reach, 0), (0, reach))):
            sides = []
            for way in (1, -1):
                p, q = x + way * i, y + way * j
                if 0 <= p < disparity.shape[1] and 0 <= q < disparity.shape[0]:
                    side = way * (float(disparity[q, p]) - float(disparity[y, x])) / reach
                    sides += [] if math.isnan(side) else [side]
            found = min(sides, key=abs, default=0.0)
            if len(sides) == 2 and abs(sides[0] - sides[1]) <= 0.5:
                found = sum(sides) / 2
            out[axis, y, x] = found if abs(found) <= largest else 0.0
    return out


def evidence(pictures, planes, guide, radius, stride, direction, weighted, noise, damping, largest_step, keep):
    """One Gauss-Newton step of a leaning window, its information and the variance that is left.

    pictures: reference and other view; planes: disparity and its slopes along x and y. With the mean difference c of
    grey levels removed, the step d makes the sum of w (e - c - direction d g)^2 smallest, but for the damping.
    """
    (ours, theirs), (height, width) = np.array(pictures, float), planes[0].shape
    moved, information, residual = planes[0].astype(float), np.zeros(guide.shape[1:]), np.full(guide.shape[1:], 1e6)
    for y, x in np.ndindex(height, width):
        value, slope_x, slope_y = (float(plane[y, x]) for plane in planes)
        if math.isnan(value) or x % stride or y % stride:
            continue
        rows = []
        for q in range(max(0, y - radius), min(height, y + radius + 1)):
            for p in range(max(1, x - radius), min(width - 1, x + radius + 1)):
                u = p + direction * (value + slope_x * (p - x) + slope_y * (q - y))
                if not 1 <= u < width - 2:
                    continue
                left, _, right = samples = [bilinear(theirs[q : q + 1, :, None], u + k, 0)[0] for k in (-1, 0, 1)]
                gradient = ((right - left) / 2 + (ours[q, p + 1] - ours[q, p - 1]) / 2) / 2
                rows.append((likeness(guide, x, y, p, q) if weighted else 1.0, gradient, ours[q, p] - samples[1]))
        w, g, e = np.array(rows).reshape(-1, 3).T
        if w.sum() < 3:
            continue
        g, e = g - (w * g).sum() / w.sum(), e - (w * e).sum() / w.sum()
        step = direction * (w * g * e).sum() / ((w * g * g).sum() + damping * noise)
        step = min(max(step, -largest_step), largest_step)
        residual[y, x] = (w * (e - direction * step * g) ** 2).sum() / w.sum()
        information[y, x] = (w * g * g).sum() / (2 * noise + residual[y, x])
        if information[y, x] > 0:
            moved[y, x] += step * information[y, x] / (information[y, x] + keep)
    return moved, information, residual


def census(picture):
    """24 comparisons with the centre as one number, the first of the window in the highest bit."""
    height, width = picture.shape
    bits = np.zeros((height, width), np.int64)
    for y in range(height):
        for x in range(width):
            for j in range(-2, 3):
                for i in range(-2, 3):
                    if (i, j) != (0, 0):
                        near = picture[clamp(y + j, height), clamp(x + i, width)]
                        bits[y, x] = bits[y, x] * 2 + int(near < picture[y, x])
    return bits


def guide(picture, levels):
    """value gain + offset of three planes, rounded to whole levels 0..255; of a grey picture three equal ones."""
    height, width = picture.shape[:2]
    out = np.empty((3, height, width))
    for c in range(3):
        for y in range(height):
            for x in range(width):
                value = float(picture[y, x] if picture.ndim == 2 else picture[y, x, c])
                level = math.floor(value * levels[2 * c] + levels[2 * c + 1] + 0.5)
                out[c, y, x] = min(max(level, 0), 255)
    return out


NO_MATCH, UNSEEN = 255, 96


def match_cost(bits, other_bits, guide, other_guide, validity, other_validity, smallest, disparities, direction):
    """Bits and colours that differ, UNSEEN outside of the other picture, NO_MATCH where one is masked."""
    height, width = validity.shape
    cost = np.full((height, width, disparities), NO_MATCH)
    for y in range(height):
        for x in range(width):
            for i in range(disparities):
                u = x + direction * (smallest + i)
                if validity[y, x] == MASKED:
                    continue
                if not 0 <= u < width:
                    cost[y, x, i] = UNSEEN
                elif other_validity[y, u] != MASKED:
                    h = int(bits[y, x] ^ other_bits[y, u]).bit_count()
                    s = min(48, sum(abs(int(guide[c, y, x]) - int(other_guide[c, y, u])) for c in range(3)))
                    cost[y, x, i] = (h * (48 - h) * 45 >> 8) + (s * (96 - s) * 5 >> 8)
    return cost


UNMATCHED = 60000


def aggregate(cost, guide, heading, row_slope, penalties, edge_penalties, edge, sums):
    """The sums once the paths of a heading are set (heading 0) or added to them, in whole numbers.

    penalties, edge_penalties: of a change by one disparity and of a larger one, and where the guide changes by `edge`.
    """
    height, width, disparities = cost.shape
    total = np.zeros(cost.shape, int)
    for step_x, step_y in ((1, 0), (-1, 0)) if heading == 0 else ((0, heading), (1, heading), (-1, heading)):
        paths = {}
        for y in range(height) if step_y >= 0 else range(height - 1, -1, -1):
            for x in range(width) if step_x >= 0 else range(width - 1, -1, -1):
                path = [UNSEEN if c == NO_MATCH else int(c) for c in cost[y, x]]
                q = (x - step_x, y - step_y)
                if q in paths:
                    old = paths[q]
                    change = max(abs(int(plane[y, x]) - int(plane[q[1], q[0]])) for plane in guide)
                    small, large = edge_penalties if change >= edge else penalties
                    for i in range(disparities):
                        ways = [min(old) + large]
                        for off, penalty in ((0, 0), (-1, small), (1, small)):
                            e = i - row_slope * step_y + off
                            if 0 <= e < disparities:
                                ways.append(old[e] + penalty)
                        path[i] += min(ways) - min(old)
                paths[x, y] = path
                total[y, x] += path
    if heading == 0:
        return np.where(cost == NO_MATCH, UNMATCHED, total)
    return sums + total


def lowest(sums, validity, smallest, subpixel):
    """Disparity, lowest sum, its ratio to the lowest one elsewhere, and validity of every pixel."""
    height, width, disparities = sums.shape
    values = np.full((height, width), np.nan, np.float32)
    lows, ratio = np.full((height, width), UNMATCHED, np.float32), np.ones((height, width), np.float32)
    reasons = validity.copy()
    for y in range(height):
        for x in range(width):
            row = [int(v) for v in sums[y, x]]
            best = min(row)
            if validity[y, x] or best >= UNMATCHED:
                reasons[y, x] = validity[y, x] or OUT_OF_RANGE
                continue
            at = row.index(best)
            values[y, x] = smallest + at
            if subpixel and 0 < at < disparities - 1 and max(row[at - 1], row[at + 1]) < UNMATCHED:
                bend = np.float32(row[at - 1] + row[at + 1] - 2 * best)
                values[y, x] += np.float32(0.5) * np.float32(row[at - 1] - row[at + 1]) / bend
            lows[y, x] = best
            elsewhere = [v for i, v in enumerate(row) if abs(i - at) > 1 and v < UNMATCHED]
            if elsewhere:
                ratio[y, x] = np.float32(best + 100) / np.float32(min(elsewhere) + 100)
    return values, lows, ratio, reasons


def merge(maps, rival_maps, radius, margin):
    """The rival where its lowest sums are lower by more than margin on average around, or where it alone has a value.

    maps, rival_maps: disparity, lowest sum, validity and ratio.
    """
    height, width = maps[0].shape
    merged = [array.copy() for array in maps]
    counts = ~np.isnan(maps[0]) & ~np.isnan(rival_maps[0])
    for y, x in np.ndindex(height, width):
        gains = [
            float(maps[1][q, p]) - float(rival_maps[1][q, p])
            for q in range(max(0, y - radius), min(height, y + radius + 1))
            for p in range(max(0, x - radius), min(width, x + radius + 1))
            if counts[q, p]
        ]
        better = bool(gains) and sum(gains) / len(gains) > margin
        if not math.isnan(rival_maps[0][y, x]) and (math.isnan(maps[0][y, x]) or better):
            for mine, theirs in zip(merged, rival_maps, strict=True):
                mine[y, x] = theirs[y, x]
    return merged


def choose(narrow, wide):
    """Of two maps, each with its score, ratio and reason, the first one wherever it has a value."""
    chosen = [array.copy() for array in narrow]
    for y, x in np.ndindex(narrow[0].shape):
        if math.isnan(narrow[0][y, x]):
            for mine, theirs in zip(chosen, wide, strict=True):
                mine[y, x] = theirs[y, x]
    return chosen


def fill(disparity, validity, axis, reach, near, edges, tolerance):
    """Join the ends of holes along each row (axis 0) or column; background where the ends differ.

    Args:
        reach: the longest hole that is filled.
        near: of the first two values in so many places next to a hole the smaller is its end.
        edges: whether one at the edge of picture or mask takes the end that it has.
    """
    if axis:
        return [array.T for array in fill(disparity.T, validity.T, 0, reach, near, edges, tolerance)]
    height, width = disparity.shape
    values, out = disparity.copy(), validity.copy()

    def end(y, columns):
        """The smaller of the first two values in these columns, but none beyond a masked one."""
        found = []
        for x in columns:
            if not 0 <= x < width or validity[y, x] & MASKED:
                break
            found += [] if math.isnan(disparity[y, x]) else [disparity[y, x]]
        return min(found[:2], default=math.nan)

    for y in range(height):
        x = 0
        while x < width:
            if not math.isnan(disparity[y, x]) or validity[y, x] & MASKED:
                x += 1
                continue
            stop = x
            while stop < width and math.isnan(disparity[y, stop]) and not validity[y, stop] & MASKED:
                stop += 1
            ends = end(y, range(x - 1, x - 1 - near, -1)), end(y, range(stop, stop + near))
            given = [value for value in ends if not math.isnan(value)]
            if stop - x <= reach and len(given) + bool(edges) >= 2 and given:
                for k in range(x, stop):
                    share = (k - x + 1) / (stop - x + 1)
                    joined = len(given) == 2 and abs(ends[1] - ends[0]) <= tolerance
                    values[y, k] = ends[0] + (ends[1] - ends[0]) * share if joined else min(given)
                    out[y, k] |= FILLED
            x = stop
    return values, out


def unfilled(disparity, validity, taken):
    """The disparity without what was filled in (32) and not taken since."""
    return np.where((validity & 32 != 0) & (taken == 0), np.nan, disparity)


def cells(moved, information, cell, least):
    """Of each square cell: the weight of its pixels, and their weighted mean column, row and disparity."""
    height, width = moved.shape
    out = np.zeros((4, -(-height // cell), -(-width // cell)))
    for row in range(out.shape[1]):
        for column in range(out.shape[2]):
            weights, seen = [], []
            for y in range(row * cell, min(row * cell + cell, height)):
                for x in range(column * cell, min(column * cell + cell, width)):
                    if information[y, x] >= least and not math.isnan(moved[y, x]):
                        weights.append(1 / (1 / float(information[y, x]) + 0.01))
                        seen.append((x, y, float(moved[y, x])))
            if weights:
                out[0, row, column] = sum(weights)
                out[1:, row, column] = np.average(seen, axis=0, weights=weights)
    return out


def planes(cells, shape, cell, spacing, reach, tolerance):
    """Value in the middle, two slopes and share of the robust plane through the cells around each place of a grid."""
    side = cell * spacing
    out = np.zeros((4, *shape))
    for row in range(shape[0]):
        for column in range(shape[1]):
            middle_x, middle_y = column * spacing + spacing // 2, row * spacing + spacing // 2
            rows = slice(max(middle_y - reach, 0), middle_y + reach + 1)
            columns = slice(max(middle_x - reach, 0), middle_x + reach + 1)
            own, x, y, v = cells[:, rows, columns].reshape(4, -1).astype(float)
            dx, dy = x - (column * side + (side - 1) / 2), y - (row * side + (side - 1) / 2)
            near = own * np.maximum(1 - (dx**2 + dy**2) / (cell * reach) ** 2, 0) ** 3
            value, along_x, along_y, weight = 0.0, 0.0, 0.0, near
            for scale in (4, 2, 1, None):
                n = weight.sum()
                if n <= 1e-6:
                    value = along_x = along_y = math.nan
                    break
                mean_x, mean_y, mean_v = ((weight * a).sum() / n for a in (dx, dy, v))
                xx, xy, yy, xv, yv = (
                    (weight * a * b).sum()
                    for a, b in (
                        (dx - mean_x, dx - mean_x),
                        (dx - mean_x, dy - mean_y),
                        (dy - mean_y, dy - mean_y),
                        (dx - mean_x, v - mean_v),
                        (dy - mean_y, v - mean_v),
                    )
                )
                stiff = n * cell**2 / 4
                slopes = np.linalg.solve([[xx + stiff, xy], [xy, yy + stiff]], [xv, yv])
                along_x, along_y = np.clip(slopes, -1, 1)
                value = mean_v - along_x * mean_x - along_y * mean_y
                if scale:
                    off = v - value - along_x * dx - along_y * dy
                    weight = near * (1 / (1 + (off / scale) ** 2)) ** 2
            if math.isnan(value):
                out[0, row, column] = math.nan
                continue
            on_it = abs(v - value - along_x * dx - along_y * dy) <= tolerance
            out[:, row, column] = value, along_x, along_y, near[on_it].sum() / near.sum()
    return out


def triangulate(disparity, direction, focal_px, baseline, cx_left, cx_right, cy):
    """Points in the frame of the rectified left camera."""
    height, width = disparity.shape
    points = np.full((height, width, 3), np.nan)
    for y in range(height):
        for x in range(width):
            d = disparity[y, x]
            parallax = d - (cx_left - cx_right)
            if not math.isnan(d) and parallax > 0:
                x_left = x + d if direction > 0 else x
                z = focal_px * baseline / parallax
                points[y, x] = (x_left - cx_left) * z / focal_px, (y - cy) * z / focal_px, z
    return points


def share_around(flags, x, y, radius):
    """Share of the (2 radius + 1) squared places around (x, y) in the picture at which a flag is set."""
    around = flags[max(0, y - radius) : y + radius + 1, max(0, x - radius) : x + radius + 1]
    return np.count_nonzero(around) / around.size


def agreement(checked, taken, radius):
    """Share of the surroundings that has a value and is not taken."""
    good = ~np.isnan(checked) & (taken == 0)
    return np.array([[share_around(good, x, y, radius) for x in range(good.shape[1])] for y in range(good.shape[0])])


def majority(wanted, plane, disparity, radius):
    """Take the plane where at least half of the surroundings want it."""
    taken = np.zeros(wanted.shape, np.uint8)
    for y, x in zip(*np.nonzero(~np.isnan(plane)), strict=True):
        taken[y, x] = share_around(wanted, x, y, radius) >= 0.5
    return np.where(taken, plane, disparity), taken


def mixed_plane(planes, x, y, pitch):
    """Value at (x, y), slopes and share of the four planes around, by distance and the cube of shares; None if none."""
    half = (pitch - 1) / 2
    column, row = math.floor((x - half) / pitch), math.floor((y - half) / pitch)
    a, b = (x - half) / pitch - column, (y - half) / pitch - row
    weight, mixed = 0.0, np.zeros(4)
    for j, i in np.ndindex(2, 2):
        v, u = clamp(row + j, planes.shape[1]), clamp(column + i, planes.shape[2])
        value, along_x, along_y, share = planes[:, v, u].astype(float)
        if not math.isnan(value):
            w = (a if i else 1 - a) * (b if j else 1 - b) * (share**3 + 1e-4)
            here = value + along_x * (x - u * pitch - half) + along_y * (y - v * pitch - half)
            weight += w
            mixed += w * np.array([here, along_x, along_y, share])
    return mixed / weight if weight > 0 else None


def unexplained(reference, other, x, y, direction, disparity, along_x, along_y):
    """Variance over 5 x 5 pixels of the difference of the views on a leaning surface, edges repeated."""
    height, width = reference.shape
    left = []
    for j in range(-2, 3):
        for i in range(-2, 3):
            row, column = clamp(y + j, height), clamp(x + i, width)
            shift = direction * (disparity + along_x * i + along_y * j)
            u, share = column + math.floor(shift), shift - math.floor(shift)
            seen = other[row, clamp(u, width)] * (1 - share) + other[row, clamp(u + 1, width)] * share
            left.append(float(reference[row, column]) - seen)
    return float(np.var(left))


def flat(reference, other, planes, disparity, agreement, pitch, direction, noise, least_agreement, least_share):
    """Plane, slopes, and whether the plane is wanted, at every pixel."""
    height, width = reference.shape
    found, wanted = np.zeros((3, height, width)), np.zeros((height, width), np.uint8)
    for y in range(height):
        for x in range(width):
            mixed = mixed_plane(planes, x, y, pitch)
            if mixed is None:
                found[0, y, x] = math.nan
                continue
            found[:, y, x] = mixed[:3]
            if not (agreement[y, x] < least_agreement and mixed[3] > least_share):
                continue
            mine = unexplained(reference, other, x, y, direction, *mixed[:3])
            given = float(disparity[y, x])
            theirs = 1e6 if math.isnan(given) else unexplained(reference, other, x, y, direction, given, 0, 0)
            outside = not 0 <= x + direction * mixed[0] <= width - 1
            wanted[y, x] = mine <= theirs + 1.5 * noise and (mine <= 16 * noise or outside)
    return *found, wanted


def bilinear(picture, u, v):
    """Sample of a (H, W, C) picture at column u, row v, the edge repeated."""
    height, width = picture.shape[:2]
    x, y = math.floor(u), math.floor(v)
    a, b = u - x, v - y

    def at(i, j):
        return picture[clamp(j, height), clamp(i, width)].astype(float)

    return (at(x, y) * (1 - a) + at(x + 1, y) * a) * (1 - b) + (at(x, y + 1) * (1 - a) + at(x + 1, y + 1) * a) * b


def rectify(picture, matrix, distortion, ray, size):
    """Undistort and rectify a (H, W, C) picture: the colour and whether the raw picture reaches there."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = [*distortion, *([0.0] * (12 - len(distortion)))]
    width, height = size
    out = np.zeros((height, width, picture.shape[2]), picture.dtype)
    valid = np.zeros((height, width), np.uint8)
    for y in range(height):
        for x in range(width):
            a, b, depth = ray @ (x, y, 1.0)
            if depth <= 0:
                continue
            a, b = a / depth, b / depth
            r2 = a * a + b * b
            radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
            bent_a = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a) + s1 * r2 + s2 * r2**2
            bent_b = b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b + s3 * r2 + s4 * r2**2
            u = matrix[0, 0] * bent_a + matrix[0, 2]
            v = matrix[1, 1] * bent_b + matrix[1, 2]
            if 0 <= u <= picture.shape[1] - 1 and 0 <= v <= picture.shape[0] - 1:
                valid[y, x] = 1
                out[y, x] = np.floor(bilinear(picture, u, v) + 0.5)
    return out, valid


INSIDE, CLOSE = 1 << 30, 1 << 29  # added to an owner's number where it holds the texel's centre, or is near it


def cover(corners, size, reach):
    """Number of the last triangle, from 1, that holds each texel's centre, and INSIDE; else of one near it.

    That is the last one of which it is within half of `reach` of the inner side of all three sides, and CLOSE, or
    within `reach`; and of the box around the triangle.
    """
    width, height = size
    owner = np.zeros((height, width), int)
    for number, triangle in enumerate(corners, 1):
        places = np.column_stack([triangle[:, :2], np.ones(3)]).T
        area = np.linalg.det(places)
        if abs(area) < 1e-12:
            continue
        heights = [abs(area) / np.linalg.norm(triangle[k - 1, :2] - triangle[k - 2, :2]) for k in range(3)]
        low = np.floor(triangle[:, :2].min(axis=0) - reach)
        high = np.ceil(triangle[:, :2].max(axis=0) + reach)
        for y in range(height):
            for x in range(width):
                if not (low[0] <= x < high[0] and low[1] <= y < high[1]):
                    continue
                shares = np.linalg.solve(places, (x + 0.5, y + 0.5, 1.0))
                if shares.min() >= 0:
                    owner[y, x] = max(owner[y, x], number + INSIDE)
                elif (shares * heights).min() >= -reach / 2:
                    owner[y, x] = max(owner[y, x], number + CLOSE)
                elif (shares * heights).min() >= -reach:
                    owner[y, x] = max(owner[y, x], number)
    return owner


def place(corners, owner, margin, size):
    """(2, H, W): where in the other picture each texel lies; corners (F, 3, 5): texel x, y, then u, v and weight."""
    width, height = size
    out = np.full((2, height, width), np.nan)
    for y in range(height):
        for x in range(width):
            if owner[y, x]:
                triangle = corners[owner[y, x] % CLOSE - 1]
                places = np.column_stack([triangle[:, :2], np.ones(3)]).T
                shares = np.linalg.solve(places, (x + 0.5, y + 0.5, 1.0))
                if owner[y, x] > INSIDE:
                    shares = shares * triangle[:, 4]
                found = shares @ triangle[:, 2:4] / shares.sum()
                ends = triangle[:, 2:4].min(axis=0) - margin, triangle[:, 2:4].max(axis=0) + margin
                out[:, y, x] = np.clip(found, *ends)
    return out


def bicubic(picture, u, v):
    """Sample of a (H, W, C) picture at column u, row v by Catmull and Rom's cubic, the edge repeated."""

    def share(distance):
        """Keys 1981, equation 15."""
        s = abs(distance)
        if s <= 1:
            return 1.5 * s**3 - 2.5 * s**2 + 1
        return -0.5 * s**3 + 2.5 * s**2 - 4 * s + 2 if s < 2 else 0.0

    height, width = picture.shape[:2]
    total = np.zeros(picture.shape[2])
    for j in range(math.floor(v) - 1, math.floor(v) + 3):
        for i in range(math.floor(u) - 1, math.floor(u) + 3):
            total += share(u - i) * share(v - j) * picture[clamp(j, height), clamp(i, width)].astype(float)
    return total


def bake(light, places, cell, bias, gain, texture):
    """Add (sample - bias) gain to every texel with a place in the picture, of which a pixel of `light` is a cell."""
    out = texture.copy()
    for y, x in np.ndindex(texture.shape[:2]):
        u, v = places[:, y, x]
        if not math.isnan(u):
            value = bicubic(light, (u + 0.5) / cell - 0.5, (v + 0.5) / cell - 0.5)
            out[y, x] = np.floor(np.clip(texture[y, x] + (value - bias) * gain, 0, 65535) + 0.5)
            out[y, x, 3] = 65535
    return out


def residual(light, texture, places):
    """32768 and half of what a pixel has more than the texture at its place; 32768 without one, or beside a gap."""
    out = np.full_like(light, 32768)
    height, width = texture.shape[:2]
    for y, x in np.ndindex(light.shape[:2]):
        s, t = places[:, y, x]
        if math.isnan(s):
            continue
        near = [(clamp(math.floor(t) + j, height), clamp(math.floor(s) + i, width)) for j in (0, 1) for i in (0, 1)]
        if all(texture[at][3] for at in near):
            out[y, x] = np.floor(32768.5 + (light[y, x].astype(float) - bilinear(texture, s, t)) / 2)
    return out


def decode(picture, valid, table):
    """The table's light of every valid level, and 65535; a grey picture has the same three times."""
    height, width, channels = picture.shape
    out = np.full((height, width, 4), 65535, np.uint16)
    for y, x, channel in np.ndindex(height, width, 3):
        out[y, x, channel] = table[picture[y, x, min(channel, channels - 1)]]
    out[valid == 0] = 0
    return out


def encode(light, table):
    """The table's level of every light."""
    height, width = light.shape[:2]
    out = np.empty((height, width, 3), np.uint8)
    for y, x, channel in np.ndindex(height, width, 3):
        out[y, x, channel] = table[light[y, x, channel]]
    return out


def pull(fine):
    """Mean of those of 2 x 2 texels that are there."""
    height, width = (-(-side // 2) for side in fine.shape[:2])
    out = np.zeros((height, width, 4), np.uint16)
    for y, x in np.ndindex(height, width):
        there = [texel.astype(int) for texel in fine[2 * y : 2 * y + 2, 2 * x : 2 * x + 2].reshape(-1, 4) if texel[3]]
        if there:
            out[y, x, :3] = (sum(there)[:3] + len(there) // 2) // len(there)
            out[y, x, 3] = 65535
    return out


def push(coarse, fine):
    """What is missing is taken from the coarser level."""
    out = fine.copy()
    for y, x in np.ndindex(fine.shape[:2]):
        if not fine[y, x, 3]:
            out[y, x] = coarse[y // 2, x // 2]
    return out


def disp_comp(reference, other, smallest, disparities, radius, threshold, direction):
    """The paper's appendix: norms under a threshold are flat, shift and search, zero where nothing correlates."""
    height, width = reference.shape
    result = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            mine = window(reference, x, y, radius)
            best = 0.0
            for d in range(smallest, smallest + disparities):
                u = x + direction * d
                if not 0 <= u < width:
                    continue
                theirs = window(other, u, y, radius)
                if norm_of(mine) <= threshold or norm_of(theirs) <= threshold:
                    continue
                score = ncc(mine, theirs)
                if score > best:
                    best, result[y, x] = score, d
    return result


def norm_of(values):
    mean = sum(values) / len(values)
    return math.sqrt(sum((v - mean) ** 2 for v in values))


def multiply_add(items, rounds, factor, summand):
    """Sum of eight chains v = v factor + summand, begun at item + 0 to 7."""
    out = []
    for item in range(items):
        chains = [np.float32(item + k) for k in range(8)]
        for _ in range(rounds):
            chains = [v * np.float32(factor) + np.float32(summand) for v in chains]
        out.append(sum(chains))
    return np.array(out)


def rasterise(screen, faces, size):
    """Number of the nearest triangle, from 1, at each sample, and its 1 / depth; 0 for none; of equal ones the last.

    screen (N, 3): column, row, 1 / depth, 0 where a vertex is not to be drawn.
    """
    width, height = size
    owner, near = np.zeros((height, width), int), np.zeros((height, width))
    for number, triangle in enumerate(screen[faces].astype(float), 1):
        places = np.column_stack([triangle[:, :2], np.ones(3)]).T
        if triangle[:, 2].min() <= 0 or np.linalg.det(places) == 0:
            continue
        for y in range(height):
            for x in range(width):
                shares = np.linalg.solve(places, (x, y, 1.0))
                if shares.min() >= 0 and shares @ triangle[:, 2] >= near[y, x]:
                    owner[y, x], near[y, x] = number, shares @ triangle[:, 2]
    return owner, near


def shade(owner, screen, faces, uv, levels, colours, behind, wire, samples):
    """Colours of the triangles that each sample shows, averaged over a pixel's samples.

    levels: the texture, and each smaller copy of it; colours: background and ink.
    """
    rows, columns = owner.shape
    painted = np.zeros((rows, columns, 3)) + colours[0]
    for y in range(rows):
        for x in range(columns):
            if owner[y, x]:
                face = faces[owner[y, x] - 1]
                corners = screen[face].astype(float)
                painted[y, x] = _shade_sample(x, y, corners, uv[face], levels, colours[1], behind, wire)
    blocks = painted.reshape(rows // samples, samples, columns // samples, samples, 3)
    return np.floor(blocks.mean(axis=(1, 3)) + 0.5).astype(np.uint8)


def _shade_sample(x, y, corners, uv, levels, ink, behind, wire):
    places = np.column_stack([corners[:, :2], np.ones(3)]).T
    shares = np.linalg.solve(places, (x, y, 1.0))
    weights = shares * corners[:, 2]
    u, v = weights @ uv / weights.sum()
    twice_area = abs(np.linalg.det(places))
    laid = abs(np.linalg.det(np.column_stack([uv, np.ones(3)])))
    texels = laid * levels[0].shape[0] * levels[0].shape[1] / twice_area
    # Counter-clockwise as seen, with y down: the front.
    if np.linalg.det(places) > 0:
        v += behind
    level = 0
    while texels > 4 and level + 1 < len(levels):
        texels, level = texels / 4, level + 1
    colour = _texel_at(levels[level], u, v)
    if texels > 1 and level + 1 < len(levels):
        share = min((texels - 1) / 3, 1)
        colour = (1 - share) * colour + share * _texel_at(levels[level + 1], u, v)
    if wire:
        sides = [np.linalg.norm(corners[(i + 2) % 3, :2] - corners[(i + 1) % 3, :2]) for i in range(3)]
        heights = twice_area / np.array(sides)
        line = np.clip(wire * 0.4 + 0.5 - (shares * heights).min(), 0, 1)
        line *= np.clip(heights.min() / (10 * wire), 0.12, 0.8)
        colour = (1 - line) * colour + line * ink
    return colour


def _texel_at(level, u, v):
    """Bilinear colour of a texture (S, T, 3) at (u, v) in 0..1, its edge repeated."""
    return bilinear(level, u * level.shape[1] - 0.5, v * level.shape[0] - 0.5)


def split_triangles(disparity, corners, side, diagonal, error_px, max_jump_px, split):
    """A level of `split`, (H, W): whether the two triangles at a hypotenuse are split at its middle."""
    height, width = disparity.shape
    found = np.array(split)
    half = side // 2
    for y in range(height):
        for x in range(width):
            if diagonal:
                if x % side != half or y % side != half:
                    continue
                # Diagonals fall in every other square, as on a chess board.
                fall = 1 if (x // side + y // side) % 2 == 0 else -1
                p, q = (x - half, y - fall * half), (x + half, y + fall * half)
                tops = (x + half, y - fall * half), (x - half, y + fall * half)
            elif x % side == half and y % side == 0:
                p, q, tops = (x - half, y), (x + half, y), ((x, y - half), (x, y + half))
            elif x % side == 0 and y % side == half:
                p, q, tops = (x, y - half), (x, y + half), ((x - half, y), (x + half, y))
            else:
                continue
            found[y, x] = any(
                _must_split(disparity, corners, split, (x, y), (p, q, top), error_px, max_jump_px) for top in tops
            )
    return found


def _must_split(disparity, corners, split, middle, triangle, error_px, max_jump_px):
    height, width = disparity.shape
    across, down = zip(*triangle, strict=True)
    if min(across) < 0 or min(down) < 0 or max(across) >= width or max(down) >= height:
        # It counts where it lies in the picture with more than a side.
        return min(across) < width - 1 and min(down) < height - 1 and max(across) > 0 and max(down) > 0
    p, q, top = triangle
    legs = [((end[0] + top[0]) / 2, (end[1] + top[1]) / 2) for end in (p, q)]
    if legs[0][0] == int(legs[0][0]) and legs[0][1] == int(legs[0][1]):
        if any(split[int(y), int(x)] for x, y in legs):
            return True
    else:
        # Its halves are those of single cells: their sides are what neighbouring pixels differ by.
        for one, other in ((middle, p), (middle, q), (middle, top), (top, p), (top, q)):
            if not abs(disparity[one[::-1]] - disparity[other[::-1]]) <= max_jump_px:
                return True
    places = np.array([[x, y, 1.0] for x, y in triangle]).T
    values = np.array([corners[y, x] for x, y in triangle], float)
    for y in range(min(down), max(down) + 1):
        for x in range(min(across), max(across) + 1):
            weights = np.linalg.solve(places, (x, y, 1.0))
            if weights.min() > -1e-9 and not abs(weights @ values - disparity[y, x]) <= error_px:
                return True
    return False
