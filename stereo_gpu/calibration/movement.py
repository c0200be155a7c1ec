"""Did the cameras move between pairs? Then the pairs before agree on one R and T, and the pairs after on another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereo_gpu.calibration.bundle import POSE, Normal, scaled_inverse
from stereo_gpu.calibration.pairing import Proposals
from stereo_gpu.calibration.uncertainty import corner_variance
from stereo_gpu.types import Doubles

FEWEST_IN_GROUP = 3  # fewer pairs at one end are outliers rather than another rig
APART = 3.0  # the other group's boards, carried over, fit so many times worse than the own ones
SURE_SHARE = 0.5  # of the squares that a move takes away: then the cameras moved. Real sets that did not: up to 0.04
SURE_EVIDENCE = 20.0  # and so many times what single views take away; cameras out of step reach 13
LIKELY_SHARE, LIKELY_EVIDENCE = 0.15, 12.0  # then they may have


@dataclass(frozen=True, kw_only=True)
class Move:
    """The cameras stood one way in the first pairs, and another way in the rest.

    Args:
        first: number of the pair, from 0 among those used, from which on they stood otherwise.
        degrees: how far they turned against each other.
        share: part of the squared error that the move explains.
        evidence: squares that it takes away, in those that the rigs of single views would each take away besides.
    """

    first: int
    degrees: float
    share: float
    evidence: float

    @property
    def sure(self) -> bool:
        """Whether there is no other explanation."""
        return self.share >= SURE_SHARE and self.evidence >= SURE_EVIDENCE


def find_split(proposals: Proposals) -> int | None:
    """Number of the view from which on all views agree on another rig than before; None where there is no such view.

    For moves so large that no fit comes near both groups.
    """
    errors = proposals.errors_px.min(axis=2)  # (proposals, views)
    seen = errors[np.isfinite(errors)]
    errors = np.minimum(errors, seen.max(initial=0.0))  # infinite where a board would lie behind the camera
    views = errors.shape[1]
    own = proposals.view[:, None] == np.arange(views)
    others = np.where(own, np.nan, errors)  # a proposal says nothing about the view that made it
    best: tuple[float, int] | None = None
    for first in range(FEWEST_IN_GROUP, views - FEWEST_IN_GROUP + 1):
        groups = np.arange(views) < first, np.arange(views) >= first
        worst_own, least_other, total = 0.0, np.inf, 0.0
        for group, other in (groups, groups[::-1]):
            makers = np.flatnonzero(group[proposals.view])
            if not len(makers):
                return None
            medians = np.nanmedian(others[makers][:, group], axis=1)
            maker = makers[int(medians.argmin())]
            worst_own = max(worst_own, float(np.nanpercentile(others[maker][group], 75)))
            least_other = min(least_other, float(np.percentile(errors[maker][other], 25)))
            total += float(np.nansum(others[maker][group]))
        # Percentiles forgive a view in the wrong group, the sum does not; a view that fits neither adds to it anyway.
        if least_other > APART * worst_own and (best is None or total < best[0]):
            best = total, first
    return None if best is None else best[1]


def find_move(normal: Normal, corners: int) -> Move | None:
    """The split after which two rigs would explain most of the error that one leaves; None where that is little.

    One Gauss-Newton step gives the squares that every split would take away, so that none need be fitted. What a rig
    for each single view would take away besides is how little pairs agree without any move, as where the cameras do
    not take their pictures at one moment; a move must stand out from that (an F test).

    Args:
        normal: of the fit with one rig.
        corners: how many there are, in both pictures.
    """
    information, gradient = normal.reduced()
    views, size = gradient.shape
    if views < 2 * FEWEST_IN_GROUP:
        return None
    variance = corner_variance(normal, corners)
    between = slice(size - POSE, size)
    every = _taken_by_single_views(information, gradient)
    best: Move | None = None
    for first in range(FEWEST_IN_GROUP, views - FEWEST_IN_GROUP + 1):
        after, slope = information[first:].sum(axis=0), gradient[first:].sum(axis=0)[between]
        matrix = np.block([[information.sum(axis=0), after[:, between]], [after[between], after[between, between]]])
        whole = np.concatenate([gradient.sum(axis=0), slope])
        step: Doubles = -scaled_inverse(matrix) @ whole
        taken = float(-whole @ step)
        left = max(every - taken, 0.0) / (views - 2) + POSE * variance
        found = Move(
            first=first,
            degrees=float(np.rad2deg(np.linalg.norm(step[size : size + 3]))),
            share=taken / normal.squares,
            evidence=taken / left,
        )
        if best is None or found.share > best.share:
            best = found
    likely = best is not None and best.share >= LIKELY_SHARE and best.evidence >= LIKELY_EVIDENCE
    return best if likely else None


def out_of_step(normal: Normal) -> float:
    """Share of the squares that a rig for every view by itself would take away.

    Noise in the corners leaves 0.05 to 0.15; much more means pictures of a pair that were not taken at one moment.
    """
    return _taken_by_single_views(*normal.reduced()) / normal.squares if normal.squares > 0 else 0.0


def _taken_by_single_views(information: Doubles, gradient: Doubles) -> float:
    """Squares that a rig for every view by itself would take away, with the lenses still shared."""
    lenses, between = slice(0, -POSE), slice(-POSE, None)
    cross, own = information[:, lenses, between], information[:, between, between]
    inverse = np.stack([scaled_inverse(each) for each in own])
    solved = np.einsum("vij,vj->vi", inverse, gradient[:, between])
    rest = (information[:, lenses, lenses] - cross @ inverse @ np.swapaxes(cross, 1, 2)).sum(axis=0)
    slope = (gradient[:, lenses] - np.einsum("vlj,vj->vl", cross, solved)).sum(axis=0)
    alone = float(np.einsum("vi,vi->", gradient[:, between], solved))
    return alone + float(slope @ scaled_inverse(rest) @ slope)
