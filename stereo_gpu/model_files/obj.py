"""Write a textured mesh as Wavefront OBJ with its material and picture."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.files import check_writable_file, whole_folder, write_whole
from stereo_gpu.model_files.frame import check_mesh, plain_stem, to_viewer
from stereo_gpu.model_files.texture_file import pack_texture
from stereo_gpu.types import Mesh


def write_obj(path: str | os.PathLike[str], mesh: Mesh, *, png: bytes | None = None) -> list[Path]:
    """Write `path`, and beside it its picture and its material, .png and .mtl; all three or none.

    The axes are those of the GLB (y up, z towards the viewer, the left camera at the origin), lengths stay in the
    mesh's unit. OBJ has its texture origin at the bottom left.

    Programs cut the names in an OBJ at spaces, or take a leading minus for an option. Where `path` has more than
    letters, digits and `-_.` in its name, those of the other two are made of what is left, and a checksum.

    Args:
        path: of the OBJ.
        mesh: what to write.
        png: the bytes of its picture, where they are at hand.

    Returns:
        The three paths: OBJ, MTL, PNG.

    Raises:
        InputError: the mesh's unit is unknown or its arrays do not fit, or a file cannot be written.
    """
    check_mesh(mesh)
    path = Path(path)
    if path.suffix.lower() in (".png", ".mtl"):
        raise InputError(f"{path} is the name of an OBJ's other file: name one that ends in .obj")
    check_writable_file(path)
    beside = plain_stem(path)
    uv = np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]])
    corners = np.repeat(mesh.faces + 1, 2, axis=1)  # v/vt pairs: OBJ counts from 1
    lines = [
        f"# stereo-gpu: y up, z towards the viewer, lengths in {mesh.unit}\n",
        f"mtllib {beside}.mtl\no surface\n",
        _rows("v %.7g %.7g %.7g\n", to_viewer(mesh.vertices)),
        _rows("vt %.7g %.7g\n", uv),
        "usemtl photo\n",
        _rows("f %d/%d %d/%d %d/%d\n", corners),
    ]
    # illum 1 without highlights: plain diffuse, as near to the photo as the format allows.
    described = f"newmtl photo\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {beside}.png\n"
    with whole_folder(path.parent) as new:
        write_whole(new / f"{beside}.png", pack_texture(mesh.texture) if png is None else png)
        write_whole(new / f"{beside}.mtl", described)
        write_whole(new / path.name, "".join(lines))
    return [path, path.with_name(f"{beside}.mtl"), path.with_name(f"{beside}.png")]


def _rows(form: str, table: np.ndarray) -> str:
    """One line a row; a single format of all of them is four times as fast as np.savetxt."""
    return (form * len(table)) % tuple(table.ravel().tolist())
