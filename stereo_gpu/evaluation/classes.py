"""The classes of pixels that a map is scored over, from mask files where there are some and else from the truth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stereo_gpu.evaluation.masks import consistent, near_jumps, nonoccluded
from stereo_gpu.evaluation.scores import Mask
from stereo_gpu.types import Floats, View

CLASSES = ("nonocc", "all", "disc")  # Middlebury's names, in the order of its tables
DENSE = 0.5  # share of known pixels under which neither hidden surfaces nor jumps can be told from a truth


def find_classes(
    truth: Floats, given: Mapping[str, Mask], *, other: Floats | None = None, reference: View = View.LEFT
) -> tuple[dict[str, Mask], list[str]]:
    """Find the non-occluded pixels, all of them, and those near jumps of disparity.

    Args:
        truth: (H, W) px, NaN where it is unknown.
        given: masks of the truth's size that are known, by their class; the others are computed.
        other: (H, W) px, the truth of the other view, if it is known.
        reference: the view on which the truth is laid out.

    Returns:
        (H, W) bool by class, within `given["all"]` and the known truth, without classes that hold no pixel; and notes
        on what was computed and what is missing.

    Raises:
        InputError: the sizes differ.
    """
    known = np.isfinite(truth)
    dense = bool(known.mean() >= DENSE)
    notes = (
        [] if dense else [f"the truth knows {known.mean():.0%} of the pixels: too few to tell what is hidden or jumps"]
    )
    found = {"all": given.get("all", known)}
    if "nonocc" in given:
        found["nonocc"] = given["nonocc"]
    elif other is not None:
        found["nonocc"] = consistent(truth, other, reference)
        notes.append("nonocc is computed: pixels on which the truths of both views agree")
    elif dense:
        found["nonocc"] = nonoccluded(truth, reference)
        notes.append("nonocc is computed from the truth, whose unknown parts hide nothing")
    if "disc" in given:
        found["disc"] = given["disc"]
    elif dense and "nonocc" in found:
        found["disc"] = near_jumps(truth, found["nonocc"])
        notes.append("disc is computed from the truth, whose unknown parts are no jumps")
    kept = {name: found[name] & found["all"] & known for name in CLASSES if name in found}
    notes += [f"{name} holds no pixel" for name, mask in kept.items() if not mask.any()]
    return {name: mask for name, mask in kept.items() if mask.any()}, notes
