"""Measure every matcher on the real pairs and on the boards of a calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.calibrate import calibrate
from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.board_plane import find_plane, visible
from stereo_gpu.evaluation.matchers import AUTO, PRECISE, Found, Matcher, Search
from stereo_gpu.evaluation.pairs import TruePair
from stereo_gpu.evaluation.scores import Scores, score
from stereo_gpu.images import read_image
from stereo_gpu.rectify import rectify
from stereo_gpu.rig import Rig
from stereo_gpu.types import Floats

BOARD = Board(10, 7, 30.0)


@dataclass(frozen=True, kw_only=True)
class Millimetres:
    """Errors of depth over the given values."""

    median: float
    mean: float


@dataclass(frozen=True, kw_only=True)
class Result:
    """A matcher on a pair.

    Args:
        scores: by mask.
        found: the map; None where only its scores are known.
        depth: errors of depth, where the camera is known.
    """

    scores: dict[str, Scores]
    found: Found
    depth: Millimetres | None = None


@dataclass(frozen=True, kw_only=True)
class PairResults:
    """Every matcher on a pair, by name; and maps of others that came with it."""

    pair: TruePair
    results: dict[str, Result]


@dataclass(frozen=True, kw_only=True)
class FoundRange:
    """The range that was found for a pair.

    Args:
        name: of the pair.
        span: smallest and largest true disparity, px.
        search: smallest disparity and how many, as found.
        inside: share of the pixels with truth whose disparity the search can give.
    """

    name: str
    span: tuple[float, float]
    search: Search
    inside: float

    @property
    def ratio(self) -> float:
        """How many times as long as the true range the found one is."""
        return self.search[1] / (self.span[1] - self.span[0])


@dataclass(frozen=True, kw_only=True)
class BoardResult:
    """Every matcher on one picture of the board.

    Args:
        name: of the left picture.
        flatness_px: root mean square of the corners' disparities less the plane's.
        scores: by the name of the matcher.
        range: what was found for the whole picture; its span is the board's.
    """

    name: str
    flatness_px: float
    scores: dict[str, Scores]
    range: FoundRange


def measure_pair(pair: TruePair, matchers: Sequence[Matcher]) -> PairResults:
    """Run every matcher over the pair's own range, but for the one that finds it itself."""
    maps = {name: Found(values=values, search=pair.search) for name, values in pair.published.items()}
    maps |= {matcher.name: matcher.find(pair.left, pair.right, pair.search) for matcher in matchers}
    return PairResults(pair=pair, results={name: _result(pair, found) for name, found in maps.items()})


def found_range(name: str, truth: Floats, search: Search) -> FoundRange:
    """Hold a range against the truth; a value of the range's ends may lie half a pixel outside of it."""
    known = truth[np.isfinite(truth)]
    inside = (known >= search[0] - 0.5) & (known <= search[0] + search[1] - 0.5)
    return FoundRange(
        name=name, span=(float(known.min()), float(known.max())), search=search, inside=float(inside.mean())
    )


def board_files(data: Path) -> list[tuple[Path, Path]]:
    """The pictures of the board, left and right.

    Raises:
        InputError: there are none.
    """
    folder = data / "calibration" / "board_10x7"
    pairs = [(left, left.with_name(left.name.replace("left", "right"))) for left in sorted(folder.glob("left*.jpg"))]
    if not pairs:
        raise InputError(f"{folder} holds no left*.jpg: set STEREO_GPU_DATA to the folder of real pictures")
    return pairs


def calibrate_boards(files: Sequence[tuple[Path, Path]]) -> Rig:
    """The rig, from all pictures of the board."""
    return calibrate([left for left, _ in files], [right for _, right in files], BOARD)


def measure_boards(
    files: Sequence[tuple[Path, Path]], rig: Rig, matchers: Sequence[Matcher], backend: str | None
) -> Iterator[BoardResult]:
    """Hold every matcher against the board's plane, on each pair.

    One of them finds the range, without being told where the board is, and the others search the same one.
    """
    [finder] = (matcher for matcher in matchers if matcher.name == AUTO)
    # Over the same range it would only repeat what the finder gives.
    others = [matcher for matcher in matchers if matcher.name not in (AUTO, PRECISE)]
    for left_file, right_file in files:
        left, right = read_image(left_file), read_image(right_file)
        plane = find_plane(left, right, rig, BOARD)
        pair = rectify(left, right, rig, backend=backend)
        truth = visible(plane, pair.valid_left, pair.valid_right)
        masks = pair.valid_left, pair.valid_right
        maps = {AUTO: finder.find(pair.left, pair.right, (0, 0), masks)}
        search = maps[AUTO].search
        maps |= {matcher.name: matcher.find(pair.left, pair.right, search, masks) for matcher in others}
        yield BoardResult(
            name=left_file.stem,
            flatness_px=float(np.sqrt(np.square(plane.residuals).mean())),
            scores={name: score(found.values, truth) for name, found in maps.items()},
            range=found_range(left_file.stem, truth, search),
        )


def board_mean(results: Sequence[BoardResult], matcher: str, figure: Callable[[Scores], float]) -> float:
    """A figure on average over the pictures of the board."""
    return float(np.mean([figure(result.scores[matcher]) for result in results]))


def _result(pair: TruePair, found: Found) -> Result:
    depth = None
    if pair.depth is not None:
        both = np.isfinite(found.values) & np.isfinite(pair.truth)
        off = np.abs(pair.depth(found.values[both]) - pair.depth(pair.truth[both]))
        depth = Millimetres(median=float(np.median(off)), mean=float(off.mean()))
    scores = {name: score(found.values, pair.truth, mask) for name, mask in pair.masks.items()}
    return Result(scores=scores, found=found, depth=depth)
