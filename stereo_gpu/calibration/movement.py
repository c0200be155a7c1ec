"""Did the cameras move between pairs? Then the pairs before agree on one R and T, and the pairs after on another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereo_gpu.calibration.bundle import POSE, Normal, scaled_inverse
from stereo_gpu.calibration.pairing import Proposals
from stereo_gpu.types import Doubles

FEWEST_IN_GROUP = 3  # fewer pairs at one end are outliers rather than another rig
APART = 3.0  # the other group's boards, carried over, fit so many times worse than the own ones
SURE_SHARE = 0.5  # of the squares that a move takes away: then the cameras moved. Real sets that did not: up to 0.04
LIKELY_SHARE = 0.15  # then they may have
SURE_SQUARES = 300.0  # in variances, that a move must take away besides; real sets that did not: up to 110


@dataclass(frozen=True, kw_only=True)
class Move:
    """The cameras stood one way in the first pairs, and another way in the rest.

    Args:
        first: number of the pair, from 0 among those used, from which on they stood otherwise.
        degrees: how far they turned against each other.
        share: part of the squared error that the move explains.
    """

    first: int
    degrees: float
    share: float


def find_split(proposals: Proposals) -> int | None:
    """Number of the view from which on all views agree on another rig than before; None where there is no such view.

    For moves so large that no fit comes near both groups.
    """
    errors = proposals.errors_px.min(axis=2)  # (proposals, views)
    views = errors.shape[1]
    own = proposals.view[:, None] == np.arange(views)
    others = np.where(own, np.nan, errors)  # a proposal says nothing about the view that made it
    best: tuple[float, int] | None = None
    for first in range(FEWEST_IN_GROUP, views - FEWEST_IN_GROUP + 1):
        groups = np.arange(views) < first, np.arange(views) >= first
        worst_own, least_other = 0.0, np.inf
        for group, other in (groups, groups[::-1]):
            makers = np.flatnonzero(group[proposals.view])
            if not len(makers):
                return None
            medians = np.nanmedian(others[makers][:, group], axis=1)
            maker = makers[int(medians.argmin())]
            worst_own = max(worst_own, float(np.nanpercentile(others[maker][group], 75)))
            least_other = min(least_other, float(np.percentile(errors[maker][other], 25)))
        if least_other > APART * worst_own and (best is None or worst_own < best[0]):
            best = worst_own, first
    return None if best is None else best[1]


def find_move(normal: Normal, corners: int) -> Move | None:
    """The split after which two rigs would explain most of the error that one leaves; None where that is little.

    One Gauss-Newton step gives the squares that every split would take away, so that none need be fitted.

    Args:
        normal: of the fit with one rig.
        corners: how many there are, in both pictures.
    """
    information, gradient = normal.reduced()
    views, size = gradient.shape
    if views < 2 * FEWEST_IN_GROUP:
        return None
    variance = normal.squares / max(1, 2 * corners - size - POSE * views)
    between = slice(size - POSE, size)
    best = Move(first=0, degrees=0.0, share=0.0)
    for first in range(FEWEST_IN_GROUP, views - FEWEST_IN_GROUP + 1):
        after, slope = information[first:].sum(axis=0), gradient[first:].sum(axis=0)[between]
        matrix = np.block([[information.sum(axis=0), after[:, between]], [after[between], after[between, between]]])
        whole = np.concatenate([gradient.sum(axis=0), slope])
        step: Doubles = -scaled_inverse(matrix) @ whole
        taken = float(-whole @ step)
        if taken > best.share * normal.squares and taken > SURE_SQUARES * variance:
            turned = float(np.rad2deg(np.linalg.norm(step[size : size + 3])))
            best = Move(first=first, degrees=turned, share=taken / normal.squares)
    return best if best.share >= LIKELY_SHARE else None
