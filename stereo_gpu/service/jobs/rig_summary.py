"""What a list of rigs shows of one."""

from __future__ import annotations

from typing import Any

from stereo_gpu.rig import Rig


def summarise(rig: Rig) -> dict[str, Any]:
    """`RigRecord.summary` of a rig; an error is None where nothing is known of it."""
    width, height = rig.left.size
    return {
        "width": width,
        "height": height,
        "baseline": rig.baseline,
        "unit": rig.unit,
        "focal_px": float(rig.left.matrix[0, 0]),
        # 0 where the file did not say.
        "rms_px": rig.rms_px or None,
        "epipolar_rms_px": rig.epipolar_rms_px or None,
    }
