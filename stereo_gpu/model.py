"""From a disparity map and its points to a textured mesh: the stages of the model, a line each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MeshOptions
from stereo_gpu.decimate import decimate
from stereo_gpu.fairing import fair
from stereo_gpu.mesh import build_mesh
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.texture import bake_texture, project
from stereo_gpu.timing import Stopwatch
from stereo_gpu.types import Floats, Mesh, RectifiedPair, Surface, View
from stereo_gpu.unwrap import Unwrapped, unwrap

Show = Callable[[str, object], None]  # told the name of what is there now, and handed it


@dataclass(frozen=True, kw_only=True)
class Model:
    """A mesh, and what it was made from.

    Args:
        surface: as it comes from the disparity map.
        smoothed: smoothed and decimated.
        unwrapped: the same with texture coordinates.
        mesh: the same with its texture.
    """

    surface: Surface
    smoothed: Surface
    unwrapped: Unwrapped
    mesh: Mesh


def build_model(
    device: Backend,
    values: Floats,
    points: Floats,
    pair: RectifiedPair,
    view: View,
    picture: DeviceArray,
    scale: float,
    options: MeshOptions,
    watch: Stopwatch,
    show: Show,
) -> Model:
    """Mesh what a view shows, and put its picture on it.

    Args:
        device: where the texture is baked.
        values: (H, W) float32 disparity on `view`, px; NaN where there is none.
        points: (H, W, 3) float32, the point that each pixel shows.
        pair: for its geometry.
        view: which the map is laid out on.
        picture: its rectified picture, on the device.
        scale: factor that takes the picture's values to 0..255.
        options: how the mesh is made.
        watch: times the stages.
        show: handed "surface", "smoothed" (and decimated) and "mesh" as they are there.

    Raises:
        StageError: nothing is left to make a mesh of.
    """
    centre = (pair.baseline if view is View.RIGHT else 0.0, 0.0, 0.0)
    frame = ViewFrame(pair.focal_px, pair.baseline, centre)
    with watch.step("mesh"):
        surface = build_mesh(
            values,
            points,
            device=device,
            method=options.method,
            error_px=options.error_px,
            max_jump_px=options.max_jump_px,
            smallest_part=options.smallest_part,
            centre=centre,
            infinity_px=pair.cx_left - pair.cx_right,
        )
    show("surface", surface)
    with watch.step("smooth"):
        smoothed = fair(surface, frame, iterations=options.smoothing)
    with watch.step("decimate"):
        # After smoothing: triangles spent on noise would be missing elsewhere.
        if options.faces or options.decimate_error:
            smoothed = decimate(smoothed, options.faces, frame, error=options.decimate_error)
    show("smoothed", smoothed)
    with watch.step("unwrap"):
        seen = project(smoothed.vertices, pair, view)[:, :2]
        unwrapped = unwrap(smoothed, seen, method=options.unwrap, time_limit_s=options.unwrap_seconds)
    with watch.step("texture"):
        texture = bake_texture(device, picture, scale, unwrapped, pair, view)
    mesh = Mesh(vertices=unwrapped.vertices, faces=unwrapped.faces, uv=unwrapped.uv, texture=texture, unit=pair.unit)
    show("mesh", mesh)
    return Model(surface=surface, smoothed=smoothed, unwrapped=unwrapped, mesh=mesh)
