"""The measurements as tables of docs/accuracy.md."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from stereo_gpu.evaluation.accuracy import BoardResult, FoundRange, PairResults, board_mean
from stereo_gpu.evaluation.cost import Cost
from stereo_gpu.evaluation.matchers import AUTO, FAST, YARDSTICK
from stereo_gpu.evaluation.scores import Scores
from stereo_gpu.evaluation.sparsification import sparsify

BOARD_COLUMNS = (AUTO, FAST, YARDSTICK)  # told picture by picture


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table, the first column to the left and the others to the right."""
    lines = [head, ["---", *("---:" for _ in head[1:])], *rows]
    return [f"| {' | '.join(line)} |" for line in lines]


def pair_table(measured: PairResults) -> list[str]:
    """Scores of every matcher on a pair, over all the masks that it has, and in mm where its camera is known."""
    pair, first = measured.pair, measured.pair.mask
    others = [name for name in ("nonocc", "all", "disc") if name in pair.masks and name != first]
    head = [pair.name.capitalize(), "bad-0.5", "bad-1.0", "bad-2.0", "of the given", "coverage"]
    head += [*others, "mean px", "rms px"] + (["median mm", "mean mm"] if pair.depth else [])
    rows = []
    for name, result in measured.results.items():
        main = result.scores[first]
        cells = [name, *(percent(main.bad[limit]) for limit in (0.5, 1.0, 2.0))]
        cells += [percent(main.bad_given[1.0]), percent(main.coverage)]
        cells += [percent(result.scores[mask].bad[1.0]) for mask in others]
        cells += [f"{main.mean:.2f}", f"{main.rms:.2f}"]
        if result.depth:
            cells += [f"{result.depth.median:.1f}", f"{result.depth.mean:.1f}"]
        rows.append(cells)
    height, width = pair.truth.shape
    title = f"{pair.name.capitalize()}: {width} x {height}, {pair.search[1]} disparities,"
    counted = f"{main.counted} {'non-occluded pixels' if first == 'nonocc' else 'pixels with truth, occluded ones too'}"
    away = ""
    if pair.depth:
        ends = pair.depth(np.array(pair.span[::-1], np.float32))
        away = f", {ends[0] / 1000:.1f} to {ends[1] / 1000:.1f} m away"
    return [f"{title} {counted}{away}.", "", *table(head, rows)]


def light_table(same: PairResults, others: Sequence[PairResults]) -> list[str]:
    """Bad-1.0 on a pair in the same light, and in points above it in other light."""
    head = ["Aloe", "same light and exposure"]
    head += [column for other in others for column in (other.pair.name.removeprefix("aloe, "), "points more")]
    rows = []
    for name, result in same.results.items():
        base = result.scores[same.pair.mask].bad[1.0]
        cells = [name, percent(base)]
        for other in others:
            bad = other.results[name].scores[other.pair.mask].bad[1.0]
            cells += [percent(bad), f"{100 * (bad - base):+.2f}"]
        rows.append(cells)
    return table(head, rows)


def board_tables(boards: Sequence[BoardResult]) -> Iterator[str]:
    """Averages of every matcher over the pictures of the board, and some matchers picture by picture."""
    head = [f"Board, average of {len(boards)} pairs", "coverage", "median px", "bad-1.0", "of the given"]
    rows = []
    for name in boards[0].scores:
        means = [board_mean(boards, name, figure) for figure in (_coverage, _median, _bad, _bad_given)]
        rows.append([name, percent(means[0]), f"{means[1]:.2f}", percent(means[2]), percent(means[3])])
    yield from table(head, rows)
    yield ""
    yield "Coverage, median error in px and bad-1.0 of each pair; flatness: how far its corners are off the plane, rms."
    yield ""
    rows = []
    for board in boards:
        low, high = board.range.span
        cells = [board.name, f"{low:.0f} to {high:.0f}", f"{board.flatness_px:.2f} px"]
        rows.append(cells + [_brief(board.scores[name]) for name in BOARD_COLUMNS])
    yield from table(["Board", "disparities", "flatness", *BOARD_COLUMNS], rows)


def range_table(pairs: Sequence[FoundRange], boards: Sequence[FoundRange]) -> Iterator[str]:
    """Ranges that were found; those of boards show a board only, in front of a room whose truth is not known."""
    rows = [_range_row(each) for each in pairs]
    if pairs:
        ratio = float(np.mean([each.ratio for each in pairs]))
        inside = min(each.inside for each in pairs)
        rows.append(["average", "", "", f"{ratio:.2f}", f"{percent(inside)} at least"])
    rows += [_range_row(each) for each in boards]
    yield from table(["Pair", "true", "found", "ratio", "truth inside"], rows)


def confidence_table(measured: Sequence[PairResults]) -> list[str]:
    """Areas under the sparsification curves of the profiles; OpenCV tells no confidence."""
    head = ["Pair", "matcher", "area", "best possible", "at random", "share of random"]
    rows = []
    for each in measured:
        for name, result in each.results.items():
            if result.found.confidence is None or name == AUTO:
                continue
            pair = each.pair
            curve = sparsify(result.found.values, pair.truth, result.found.confidence, pair.masks[pair.mask]).bad
            areas = [percent(area) for area in (curve.area, curve.oracle_area, curve.random_area)]
            share = curve.share_of_random
            rows.append([pair.name, name, *areas, "-" if np.isnan(share) else f"{share:.2f}"])
    return table(head, rows)


def cost_table(costs: Mapping[str, Mapping[str, Cost]], measured: Mapping[str, PairResults]) -> Iterator[str]:
    """Time of every matcher over that of the yardstick, on each input, beside what it gets wrong there.

    Args:
        costs: by input, then by matcher; the first input is the benchmark's.
        measured: by input, for those with a truth.
    """
    bench, *pairs = costs
    head = ["Accuracy against time", f"ms, {bench}", "time", "CPU time"]
    head += [column for name in pairs for column in (f"time, {name}", "bad-1.0")]
    rows = []
    for name, cost in sorted(costs[bench].items(), key=lambda item: item[1].wall):
        cells = [name, f"{1000 * cost.wall_s:.0f}", f"{cost.wall:.2f}", f"{cost.cpu:.2f}"]
        for pair in pairs:
            cells += [f"{costs[pair][name].wall:.2f}", percent(bad(measured[pair], name))]
        rows.append(cells)
    yield from table(head, rows)


def bad(measured: PairResults, matcher: str) -> float:
    """Share of the counted pixels of a pair that are wrong by more than 1 px or have no value."""
    return measured.results[matcher].scores[measured.pair.mask].bad[1.0]


def percent(share: float) -> str:
    """As 4.71 %."""
    return "-" if np.isnan(share) else f"{100 * share:.2f} %"


def _range_row(each: FoundRange) -> list[str]:
    (low, high), (smallest, count) = each.span, each.search
    found = f"{smallest} to {smallest + count - 1}"
    return [each.name, f"{low:.1f} to {high:.1f}", found, f"{each.ratio:.2f}", percent(each.inside)]


def _brief(scores: Scores) -> str:
    return f"{_coverage(scores):.0%}, {_median(scores):.2f}, {_bad(scores):.0%}"


def _coverage(scores: Scores) -> float:
    return scores.coverage


def _median(scores: Scores) -> float:
    return scores.quantiles[50]


def _bad(scores: Scores) -> float:
    return scores.bad[1.0]


def _bad_given(scores: Scores) -> float:
    return scores.bad_given[1.0]
