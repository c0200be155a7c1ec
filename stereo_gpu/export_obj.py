"""Write a textured mesh as Wavefront OBJ with its material and picture."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from stereo_gpu.export_frame import check_mesh, to_viewer
from stereo_gpu.files import write_whole
from stereo_gpu.texture_file import pack_texture
from stereo_gpu.types import Mesh


def write_obj(path: str | os.PathLike[str], mesh: Mesh) -> list[Path]:
    """Write `path`, and beside it the same name with .png and .mtl; the OBJ comes last, when all it names is there.

    The axes are those of the GLB (y up, z towards the viewer, the left camera at the origin), lengths stay in the
    mesh's unit. OBJ has its texture origin at the bottom left.

    Returns:
        The three paths: OBJ, MTL, PNG.

    Raises:
        InputError: the mesh's unit is unknown or its arrays do not fit, or a file cannot be written.
    """
    check_mesh(mesh)
    path = Path(path)
    picture, material = path.with_suffix(".png"), path.with_suffix(".mtl")
    uv = np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]])
    corners = np.repeat(mesh.faces + 1, 2, axis=1)  # v/vt pairs: OBJ counts from 1
    lines = [
        f"# stereo-gpu: y up, z towards the viewer, lengths in {mesh.unit}\n",
        f"mtllib {material.name}\no surface\n",
        _rows("v %.7g %.7g %.7g\n", to_viewer(mesh.vertices)),
        _rows("vt %.7g %.7g\n", uv),
        "usemtl photo\n",
        _rows("f %d/%d %d/%d %d/%d\n", corners),
    ]
    # illum 1 without highlights: plain diffuse, as near to the photo as the format allows.
    described = f"newmtl photo\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture.name}\n"
    write_whole(picture, pack_texture(mesh.texture))
    write_whole(material, described)
    return [write_whole(path, "".join(lines)), material, picture]


def _rows(form: str, table: np.ndarray) -> str:
    """One line a row; a single format of all of them is four times as fast as np.savetxt."""
    return (form * len(table)) % tuple(table.ravel().tolist())
