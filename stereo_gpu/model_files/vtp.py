"""Write a textured mesh as VTK XML PolyData, for ParaView."""

from __future__ import annotations

import base64
import os
import struct
from pathlib import Path

import numpy as np

from stereo_gpu.files import write_whole
from stereo_gpu.model_files.frame import check_mesh, to_viewer
from stereo_gpu.types import Bytes, Mesh

_TYPES = {"f": "Float32", "u": "UInt8", "i": "Int32"}


def write_vtp(path: str | os.PathLike[str], mesh: Mesh) -> Path:
    """Write the mesh with texture coordinates, and the texture's colour at every vertex.

    ParaView puts no texture on a mesh by itself, so the colours show it at once; for the full picture apply
    model.png as the texture. The axes are those of the other files (y up, z towards the viewer), lengths stay in
    the mesh's unit. VTK has its texture origin at the bottom left.

    Raises:
        InputError: the mesh's unit is unknown or its arrays do not fit, or the file cannot be written.
    """
    check_mesh(mesh)
    uv = np.column_stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]])
    ends = np.arange(3, 3 * len(mesh.faces) + 1, 3)
    content = [
        '<?xml version="1.0"?>\n',
        f"<!-- stereo-gpu: y up, z towards the viewer, lengths in {mesh.unit} -->\n",
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n<PolyData>\n',
        f'<Piece NumberOfPoints="{len(mesh.vertices)}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0"'
        f' NumberOfPolys="{len(mesh.faces)}">\n',
        '<PointData TCoords="TextureCoordinates" Scalars="Colors">\n',
        _array("TextureCoordinates", uv.astype("<f4")),
        _array("Colors", _colours(mesh)),
        "</PointData>\n<Points>\n",
        _array("Points", to_viewer(mesh.vertices).astype("<f4")),
        "</Points>\n<Polys>\n",
        _array("connectivity", mesh.faces.ravel().astype("<i4")),
        _array("offsets", ends.astype("<i4")),
        "</Polys>\n</Piece>\n</PolyData>\n</VTKFile>\n",
    ]
    return write_whole(path, "".join(content))


def _array(name: str, values: np.ndarray) -> str:
    components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    data = values.tobytes()
    # The length in bytes goes in front of the data, as UInt64, and is encoded with it.
    encoded = base64.b64encode(struct.pack("<Q", len(data)) + data).decode()
    kind = _TYPES[values.dtype.kind]
    return f'<DataArray type="{kind}" Name="{name}"{components} format="binary">{encoded}</DataArray>\n'


def _colours(mesh: Mesh) -> Bytes:
    """(N, 3): the texel that each vertex lies in."""
    height, width = mesh.texture.shape[:2]
    column = np.clip((mesh.uv[:, 0] * width).astype(int), 0, width - 1)
    row = np.clip((mesh.uv[:, 1] * height).astype(int), 0, height - 1)
    return np.asarray(mesh.texture[row, column])
