"""Scores as text: a line each score, a column each class of pixels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from math import isnan

from stereo_gpu.evaluation.scores import QUANTILES, THRESHOLDS, Scores
from stereo_gpu.evaluation.sparsification import Sparsification


def score_lines(scores: Mapping[str, Scores]) -> Iterator[str]:
    """The table of the scores of each class."""
    every = list(scores.values())
    yield _line("", scores)
    yield _line("pixels", [str(each.counted) for each in every])
    yield _line("coverage", [_percent(each.coverage) for each in every])
    for threshold in THRESHOLDS:
        yield _line(f"bad-{threshold}, no value = bad", [_percent(each.bad[threshold]) for each in every])
    for threshold in THRESHOLDS:
        yield _line(f"bad-{threshold} of the given", [_percent(each.bad_given[threshold]) for each in every])
    yield _line("mean error, px", [_px(each.mean) for each in every])
    yield _line("RMS error, px", [_px(each.rms) for each in every])
    for share in QUANTILES:
        yield _line(f"A{share}, px", [_px(each.quantiles[share]) for each in every])


def confidence_lines(found: Sparsification) -> Iterator[str]:
    """The areas under the sparsification curves, and how far the map's is from the oracle's."""
    yield _line("area by confidence", ["map", "oracle", "random", "AUSE", "of random"])
    for label, curve in (("bad-1.0", found.bad), ("mean error, px", found.mean)):
        areas = [f"{area:.4f}" for area in (curve.area, curve.oracle_area, curve.random_area, curve.ause)]
        yield _line(label, [*areas, _percent(curve.share_of_random)])


def _line(label: str, cells: Iterable[str]) -> str:
    return f"{label:24}" + "".join(f"{cell:>11}" for cell in cells)


def _percent(share: float) -> str:
    return "-" if isnan(share) else f"{100 * share:.2f} %"


def _px(error: float) -> str:
    return "-" if isnan(error) else f"{error:.3f}"
