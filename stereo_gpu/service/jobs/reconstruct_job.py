"""A pair and its rig to a model, in the folders of the service."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from stereo_gpu.engines.executor import Tell
from stereo_gpu.mask import mask_from_file
from stereo_gpu.pipeline import reconstruct
from stereo_gpu.result import Reconstruction
from stereo_gpu.rig import Rig
from stereo_gpu.rig_check import Verdict
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.jobs.order import WorkOrder
from stereo_gpu.service.jobs.outcome import Outcome
from stereo_gpu.service.jobs.step_pictures import StepPictures
from stereo_gpu.service.options import read_options

RIGS_KEPT = 64  # of a few MB at most; a rig of an id never changes


def reconstruct_job(order: WorkOrder, folders: Folders, backend: str | None, tell: Tell) -> Outcome:
    """Reconstruct a pair into its attempt's folder; errors are those of `reconstruct`."""
    assert order.rig is not None
    options = read_options(order.options)
    inputs = folders.inputs(order.job)
    files = {Path(name).stem: inputs / name for name in order.inputs}
    rig = _rig(folders.rig(order.rig))
    show = None
    if options.steps:
        show = StepPictures(folders.steps(order.job), options.reference, backend, tell)
    result = reconstruct(
        files["left"],
        files["right"],
        rig,
        mask=mask_from_file(files["mask"], rig.left.size) if "mask" in files else None,
        check=order.check,
        backend=backend,
        progress=tell,
        show=show,
        **options.keywords(),
    )
    tell("save")
    outcome = Outcome(
        summary=_summary(result),
        warnings=tuple(result.warnings),
        seconds=result.seconds,
        checked=order.check == "full" and result.checked.verdict is Verdict.GOOD,
    )
    result.save(
        folders.attempt(order.job, order.number),
        files=options.files,
        texture_format=options.texture_format,
        also=outcome.as_json(),
    )
    return outcome


@lru_cache(RIGS_KEPT)
def _rig(path: Path) -> Rig:
    return Rig.load(path)


def _summary(result: Reconstruction) -> dict[str, Any]:
    near, far = np.percentile(result.mesh.vertices[:, 2], [1, 99]).tolist()  # of all points it would take 3 ms
    vertical = result.checked.vertical_px
    height, width = result.mesh.texture.shape[:2]
    return {
        "triangles": len(result.mesh.faces),
        "vertices": len(result.mesh.vertices),
        "coverage": round(result.disparity.coverage, 4),
        "depth": [round(near, 3), round(far, 3)],
        "unit": result.pair.unit,
        "texture": [width, height],
        "disparities": [result.disparity.smallest, result.disparity.disparities],
        "rig": {
            "verdict": str(result.checked.verdict),
            "says": result.checked.says,
            "vertical_px": None if math.isnan(vertical) else round(vertical, 3),
        },
        "backend": result.disparity.backend,
        "device": result.disparity.device,
    }
