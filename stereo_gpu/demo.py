"""The whole chain on the built-in scene, from picture files to a model, with every error measured."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stereo_gpu.backends import open_backend
from stereo_gpu.calibrate import calibrate
from stereo_gpu.files import check_writable, whole_folder
from stereo_gpu.images import write_png
from stereo_gpu.pipeline import reconstruct
from stereo_gpu.result import Reconstruction
from stereo_gpu.rig import Rig
from stereo_gpu.scene import Scene, build_scene
from stereo_gpu.scene_render import render_boards, render_pair
from stereo_gpu.scene_truth import measure_calibration, measure_surface
from stereo_gpu.types import Doubles, Mesh

# A box that a person would draw around the two objects, as shares of the picture: x, y, width, height.
BOX = (0.094, 0.125, 0.64, 0.645)
SAMPLES = 50_000  # points of the mesh that are held against the true surface


def run_demo(
    out: str | os.PathLike[str], *, backend: str | None = None, size: tuple[int, int] = (640, 480)
) -> Iterator[str]:
    """Render the scene, calibrate, reconstruct, measure; yields a line for people after each step.

    Nothing but the pictures passes from the scene to the chain: truth is only what the result is held against.

    Args:
        out: folder for the result, with the pictures in `pictures` and the rig in rig.json.
        backend: where to compute; None takes STEREO_GPU_BACKEND, else the best device.
        size: width and height of the pictures, px.

    Raises:
        InputError: the folder cannot be written.
        BackendError: the device is missing, too small or fails.
    """
    out = Path(out)
    check_writable(out)
    device = open_backend(backend)
    start = time.perf_counter()
    yield f"rendering a block and a bear, and 15 views of a board, through two cameras ({size[0]} x {size[1]} px)"
    scene = build_scene(size)
    left_boards, right_boards = _write_pictures(scene, out / "pictures")
    yield f"wrote {2 + 2 * len(left_boards)} pictures to {out / 'pictures'} ({time.perf_counter() - start:.1f} s)"

    begun = time.perf_counter()
    rig = calibrate(left_boards, right_boards, scene.board)
    rig.save(out / "rig.json")
    used = sum(view.used for view in rig.views)
    yield (
        f"calibrated with {used} of {len(rig.views)} pairs: reprojection error {rig.rms_px:.3f} px"
        f" ({time.perf_counter() - begun:.1f} s)"
    )
    yield from _tell_calibration(scene, rig)

    result = reconstruct(
        out / "pictures" / "left.png",
        out / "pictures" / "right.png",
        rig,
        disparities="auto",
        rectangle=_box(size),
        backend=device.name,
    )
    result.save(out)
    yield (
        f"reconstructed {len(result.mesh.faces):,} triangles on {device.name} ({device.device}) in"
        f" {sum(result.seconds.values()):.1f} s"
    )
    for warning in result.warnings:
        yield f"  warning: {warning}"
    yield from _tell_surface(scene, result)
    total = time.perf_counter() - start
    yield f"all done in {total:.0f} s; open {out / 'report.html'}, the model is {out / 'model.glb'}"


def _box(size: tuple[int, int]) -> tuple[int, int, int, int]:
    x, y, wide, high = (round(share * size[axis % 2]) for axis, share in enumerate(BOX))
    return x, y, wide, high


def _write_pictures(scene: Scene, folder: Path) -> tuple[list[Path], list[Path]]:
    """Write the raw pair and the board pairs; returns the files of the left and of the right boards."""
    left, right = render_pair(scene)
    names: tuple[list[Path], list[Path]] = ([], [])
    with whole_folder(folder) as new:
        write_png(new / "left.png", left)
        write_png(new / "right.png", right)
        for number, pair in enumerate(render_boards(scene), 1):
            for side, picture, listed in zip(("left", "right"), pair, names, strict=True):
                name = f"board_{side}{number:02d}.png"
                write_png(new / name, picture)
                listed.append(folder / name)
    return names


def _tell_calibration(scene: Scene, rig: Rig) -> Iterator[str]:
    error = measure_calibration(scene, rig)
    yield (
        f"  against the true cameras: {error['rms_px']:.3f} px rms over the working volume, rows"
        f" {error['vertical_px']:.3f} px apart, baseline {error['baseline_percent']:.3f} % off, rotation"
        f" {error['rotation_degrees']:.3f} degrees off"
    )
    yield "  (measured up to one rigid motion of both cameras, which boards cannot fix and no model changes by)"


def _tell_surface(scene: Scene, result: Reconstruction) -> Iterator[str]:
    error = measure_surface(scene, result.pair, result.points, vertices=_spread_over(result.mesh))
    yield (
        f"  against the true surface: {error['coverage']:.1%} of the objects covered where both cameras see them,"
        f" depth error {error['depth_median_percent']:.2f} % (median), {error['depth_p95_percent']:.2f} % (95th"
        " percentile)"
    )
    yield (
        f"  the mesh lies {error['mesh_median_mm']:.2f} mm (median) from the true surface, 95 % of it within"
        f" {error['mesh_p95_mm']:.2f} mm"
    )


def _spread_over(mesh: Mesh) -> Doubles:
    """Points that lie evenly over a mesh, (SAMPLES, 3): its vertices crowd where it is rough, and thus often wrong."""
    import trimesh

    bare = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return np.asarray(trimesh.sample.sample_surface(bare, SAMPLES, seed=1)[0], np.float64)
