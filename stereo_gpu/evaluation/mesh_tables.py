"""Meshes against the truth, measured from pictures on and as tables of docs/accuracy.md."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from stereo_gpu.backends import open_backend
from stereo_gpu.config import MeshOptions, Profile
from stereo_gpu.evaluation.accuracy_tables import percent, table
from stereo_gpu.evaluation.cup import CupErrors, cup_rig, measure_cup
from stereo_gpu.evaluation.meshes import MeshErrors, measure_on_pair, measure_on_scene, mesh_steps
from stereo_gpu.evaluation.pairs import load_pair
from stereo_gpu.pipeline import reconstruct, reconstruct_rectified
from stereo_gpu.scene import build_scene
from stereo_gpu.scene_render import render_pair
from stereo_gpu.types import RectifiedPair

PROFILES = (Profile.FAST, Profile.PRECISE)
_BARE = MeshOptions(faces=0, smoothing=0, unwrap="view")  # the steps are made again, each for itself


def mesh_section(data: Path, backend: str | None) -> Iterator[str]:
    """The lines of the section on meshes: the built-in scene, Motorcycle and the cup."""
    for profile in PROFILES:
        yield from ("", *mesh_table(f"Built-in scene, `{profile}`", scene_errors(profile, backend)))
    for profile in PROFILES:
        yield from ("", *mesh_table(f"Motorcycle, `{profile}`", pair_errors(data, profile, backend)))
    yield from ("", *cup_table("Cup, `precise`", cup_errors(data, Profile.PRECISE, backend)))


def scene_errors(profile: str, backend: str | None) -> dict[str, MeshErrors]:
    """The built-in scene with its true rig."""
    scene = build_scene()
    result = reconstruct(*render_pair(scene), scene.rig, profile=profile, backend=backend, mesh=_BARE)
    return measure_on_scene(mesh_steps(open_backend(backend), result), result, scene)


def pair_errors(data: Path, profile: str, backend: str | None) -> dict[str, MeshErrors]:
    """Middlebury's Motorcycle, on the left view, where its truth is."""
    known = load_pair(data, "motorcycle")
    camera = json.loads((data / "stereo" / "motorcycle" / "calib.json").read_text("utf-8"))
    pair = RectifiedPair.from_geometry(
        known.left,
        known.right,
        focal_px=camera["focal_px"],
        baseline=camera["baseline_mm"],
        cx_left=camera["cx0"],
        cx_right=camera["cx0"] + camera["doffs_px"],
        cy=camera["cy"],
    )
    result = reconstruct_rectified(
        pair, profile=profile, disparities=known.search, reference="left", backend=backend, mesh=_BARE
    )
    return measure_on_pair(mesh_steps(open_backend(backend), result), pair, known)


def cup_errors(data: Path, profile: str, backend: str | None) -> dict[str, CupErrors]:
    """The cup on its table, with the rig that its owner published."""
    folder = data / "rigs" / "cup"
    left, right = (folder / "test_images" / f"{side}Pic.jpg" for side in ("left", "right"))
    result = reconstruct(left, right, cup_rig(folder), profile=profile, backend=backend, mesh=_BARE)
    return measure_cup(mesh_steps(open_backend(backend), result), result.pair)


def mesh_table(title: str, errors: Mapping[str, MeshErrors]) -> list[str]:
    """Errors of depth, and of place where the true surface is known."""
    head = [title, "triangles", "covered", "mean mm", "median mm", "95 % mm", "mean mm where within 1 px"]
    placed = any(each.nearest is not None for each in errors.values())
    rows = []
    for name, each in errors.items():
        figures = [each.mean, each.median, each.p95, each.inliers] + ([] if each.nearest is None else [each.nearest])
        rows.append([name, f"{each.faces:,}", percent(each.coverage), *(f"{figure:.2f}" for figure in figures)])
    return table([*head, "mean mm to the surface"] if placed else head, rows)


def cup_table(title: str, errors: Mapping[str, CupErrors]) -> list[str]:
    """Residuals of the table and of the wall."""
    rows = [[name, f"{each.faces:,}", f"{each.table:.2f}", f"{each.wall:.2f}"] for name, each in errors.items()]
    return table([title, "triangles", "table, rms mm", "wall, rms mm"], rows)
