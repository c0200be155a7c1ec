"""Write models, clouds and disparity maps as files that other programs open.

Every file is written whole or not at all. All models have y up, z towards the viewer and the left camera at the
origin; the GLB is in metres, as glTF demands, all others stay in the pair's unit.
"""

from __future__ import annotations

import os
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.files import whole_folder
from stereo_gpu.model_files.frame import check_mesh
from stereo_gpu.model_files.gltf import write_glb
from stereo_gpu.model_files.obj import write_obj
from stereo_gpu.model_files.ply import write_ply, write_ply_mesh
from stereo_gpu.model_files.texture_file import pack_texture
from stereo_gpu.model_files.vtp import write_vtp
from stereo_gpu.pfm import read_pfm, write_pfm
from stereo_gpu.types import Mesh

__all__ = [
    "export_model",
    "read_pfm",
    "write_glb",
    "write_obj",
    "write_pfm",
    "write_ply",
    "write_ply_mesh",
    "write_vtp",
]


def export_model(directory: str | os.PathLike[str], mesh: Mesh) -> list[Path]:
    """Write a mesh in every format, all files or none.

    These are model.glb, model.obj with model.mtl, model.png for it and model.ply, and surface.vtp.

    Args:
        directory: an existing folder.
        mesh: the textured mesh.

    Returns:
        The paths written.

    Raises:
        InputError: the mesh cannot be written, or the folder cannot.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise InputError(f"cannot write to {folder}: there is no folder of that name; make it first")
    check_mesh(mesh)
    png = pack_texture(mesh.texture)
    with whole_folder(folder) as new:
        written = [
            write_glb(new / "model.glb", mesh),
            *write_obj(new / "model.obj", mesh, png=png),
            write_ply_mesh(new / "model.ply", mesh, png=png)[0],
            write_vtp(new / "surface.vtp", mesh),
        ]
    return [folder / path.name for path in written]
