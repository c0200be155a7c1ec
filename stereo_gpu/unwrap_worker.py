"""The process in which xatlas runs, so that it can be stopped: tiles in on stdin, an atlas out on stdout.

Run as a script, never imported: it must start quickly, so it imports nothing of ours. Both streams are npz:
in   positions (N, 3) float32, faces (M, 3) uint32 within their tile, vertex_counts (T,), face_counts (T,), padding
out  vertex_map (N',) into positions, faces (M, 3) into vertex_map, uv (N', 2), size (2,) width and height, charts
"""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np
import xatlas


def main(tiles: Any) -> dict[str, Any]:
    """Cut the tiles into charts and pack all of them into one atlas, one texel a unit of length."""
    atlas = xatlas.Atlas()
    first_vertex = np.concatenate([[0], np.cumsum(tiles["vertex_counts"])])
    first_face = np.concatenate([[0], np.cumsum(tiles["face_counts"])])
    positions, faces = tiles["positions"], tiles["faces"]
    for v0, v1, f0, f1 in zip(first_vertex[:-1], first_vertex[1:], first_face[:-1], first_face[1:], strict=True):
        atlas.add_mesh(positions[v0:v1], faces[f0:f1])
    packing = xatlas.PackOptions()
    packing.texels_per_unit = 1.0
    packing.padding = int(tiles["padding"])
    atlas.generate(xatlas.ChartOptions(), packing, verbose=False)

    maps, indices, uvs, count = [], [], [], 0
    for tile in range(len(first_vertex) - 1):
        vertex_map, corners, uv = atlas[tile]
        maps.append(vertex_map.astype(np.int64) + first_vertex[tile])
        indices.append(corners.reshape(-1, 3).astype(np.int64) + count)
        uvs.append(uv)
        count += len(vertex_map)
    return {
        "vertex_map": np.concatenate(maps),
        "faces": np.concatenate(indices),
        "uv": np.concatenate(uvs),
        "size": np.array([atlas.width, atlas.height]),
        "atlases": np.array(atlas.atlas_count),
        "charts": np.array(atlas.chart_count),
    }


if __name__ == "__main__":
    answer = io.BytesIO()
    np.savez(answer, **main(np.load(io.BytesIO(sys.stdin.buffer.read()))))
    sys.stdout.buffer.write(answer.getvalue())
