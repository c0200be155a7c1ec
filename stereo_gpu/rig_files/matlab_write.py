"""Calib_Results_stereo.mat as the toolbox saves it, as `read_matlab` reads it."""

from __future__ import annotations

import io

import numpy as np

from stereo_gpu.deviations import CameraDeviations
from stereo_gpu.errors import InputError
from stereo_gpu.rig import Rig
from stereo_gpu.rig_files.matlab import DEVIATIONS


def write_matlab(rig: Rig) -> bytes:
    """The bytes of a .mat file with the toolbox's names, which its own functions load.

    Raises:
        InputError: the toolbox cannot hold this rig: other lenses, or two sizes.
    """
    import cv2
    from scipy.io import savemat

    if rig.left.size != rig.right.size:
        raise InputError(f"the pictures are {rig.left.size} and {rig.right.size}: the toolbox holds one size for both")
    content: dict[str, object] = {"nx": float(rig.left.size[0]), "ny": float(rig.left.size[1]), "unit": rig.unit}
    for side, camera in (("left", rig.left), ("right", rig.right)):
        if len(camera.distortion) != 5:
            raise InputError(
                f"{side} lens has {len(camera.distortion)} coefficients, the toolbox's has 5: write yaml, xml or json"
            )
        content[f"fc_{side}"] = np.diag(camera.matrix)[:2].reshape(2, 1)
        content[f"cc_{side}"] = camera.matrix[:2, 2:]
        content[f"kc_{side}"] = camera.distortion.reshape(5, 1)
        content[f"alpha_c_{side}"] = 0.0
        content[f"KK_{side}"] = camera.matrix
        if rig.deviations is not None:
            part: CameraDeviations = getattr(rig.deviations, side)
            content[f"fc_{side}_error"] = DEVIATIONS * np.array([[part.fx], [part.fy]])
            content[f"cc_{side}_error"] = DEVIATIONS * np.array([[part.cx], [part.cy]])
            content[f"kc_{side}_error"] = DEVIATIONS * part.distortion.reshape(5, 1)
            content[f"alpha_c_{side}_error"] = 0.0
    content |= {"om": cv2.Rodrigues(rig.R)[0], "R": rig.R, "T": rig.T.reshape(3, 1)}
    if rig.deviations is not None:
        content["om_error"] = DEVIATIONS * rig.deviations.om.reshape(3, 1)
        content["T_error"] = DEVIATIONS * rig.deviations.T.reshape(3, 1)
    stream = io.BytesIO()
    savemat(stream, content, do_compression=True)
    return stream.getvalue()
