"""Write a cloud of coloured points, or a textured mesh, as binary PLY."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.files import check_writable_file, whole_folder, write_whole
from stereo_gpu.model_files.frame import check_mesh, plain_stem, to_viewer
from stereo_gpu.model_files.texture_file import pack_texture
from stereo_gpu.types import Bytes, Floats, Mesh

_POINT = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
_VERTEX = np.dtype([("xyz", "<f4", 3), ("uv", "<f4", 2)])
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write_ply(path: str | os.PathLike[str], points: Floats, colours: Bytes) -> Path:
    """Write the finite ones of (..., 3) points with their (..., 3) RGB colours, little endian.

    The axes are those of the other files (y up, z towards the viewer), lengths stay in the points' unit. A cloud
    without a finite point is a valid file with no vertex.

    Raises:
        InputError: points and colours do not fit, or the file cannot be written.
    """
    if points.shape != colours.shape or points.shape[-1:] != (3,) or colours.dtype != np.uint8:
        raise InputError(
            f"points of shape {points.shape} and {colours.dtype} colours of shape {colours.shape} do not fit:"
            " pass (..., 3) and uint8 (..., 3)"
        )
    finite = np.isfinite(points).all(axis=-1)
    vertices = np.empty(int(finite.sum()), _POINT)
    vertices["xyz"] = to_viewer(points[finite])
    vertices["rgb"] = colours[finite]
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "comment stereo-gpu: y up, z towards the viewer\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        "end_header\n"
    )
    return write_whole(path, header.encode() + vertices.tobytes())


def write_ply_mesh(path: str | os.PathLike[str], mesh: Mesh, *, png: bytes | None = None) -> list[Path]:
    """Write a mesh with texture coordinates at its vertices, and beside it the texture, .png; both or none.

    MeshLab, trimesh and VTK know the coordinates as `texture_u` and `texture_v`, from the bottom left, and the first
    two find the texture by the comment `TextureFile`. Axes, lengths and the names of files are those of the OBJ.

    Args:
        path: of the PLY.
        mesh: what to write.
        png: the bytes of its picture, where they are at hand.

    Returns:
        The two paths: PLY, PNG.

    Raises:
        InputError: the mesh's unit is unknown or its arrays do not fit, or a file cannot be written.
    """
    check_mesh(mesh)
    path = Path(path)
    if path.suffix.lower() == ".png":
        raise InputError(f"{path} is the name of a picture: name one that ends in .ply")
    check_writable_file(path)
    picture = f"{plain_stem(path)}.png"
    vertices, faces = np.empty(len(mesh.vertices), _VERTEX), np.empty(len(mesh.faces), _FACE)
    vertices["xyz"] = to_viewer(mesh.vertices)
    vertices["uv"] = np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]])
    faces["count"], faces["corners"] = 3, mesh.faces
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"comment stereo-gpu: y up, z towards the viewer, lengths in {mesh.unit}\n"
        f"comment TextureFile {picture}\n"
        f"element vertex {len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property float texture_u\nproperty float texture_v\n"
        f"element face {len(faces)}\n"
        "property list uchar int vertex_indices\n"
        "end_header\n"
    )
    with whole_folder(path.parent) as new:
        write_whole(new / picture, pack_texture(mesh.texture) if png is None else png)
        write_whole(new / path.name, header.encode() + vertices.tobytes() + faces.tobytes())
    return [path, path.with_name(picture)]
