"""Everything that one reconstruction computed, and the files it leaves."""

from __future__ import annotations

import json
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from stereo_gpu import export, figures
from stereo_gpu.backends import open_backend
from stereo_gpu.check_figure import draw_check
from stereo_gpu.epipolar.figure import draw_epipolar_curves
from stereo_gpu.errors import InputError
from stereo_gpu.files import whole_folder, write_whole
from stereo_gpu.images import write_png
from stereo_gpu.model_files.gltf import standpoint
from stereo_gpu.model_files.texture_file import check_texture_format, pack_texture
from stereo_gpu.prepare import grey_scale
from stereo_gpu.render import Shading, render
from stereo_gpu.render_points import render_points
from stereo_gpu.report import Figure, write_report
from stereo_gpu.rig import Rig
from stereo_gpu.rig_check import RigCheck
from stereo_gpu.self_calibrate import RigFound
from stereo_gpu.turntable import page_film
from stereo_gpu.types import Bytes, Disparity, Floats, Mesh, Picture, RectifiedPair, Surface, Validity, View

# From the front every model looks like the photograph; a little from the side its depth can be judged.
YAW, PITCH = 20.0, 8.0


@dataclass(frozen=True, kw_only=True)
class Reconstruction:
    """What `reconstruct` returns.

    Args:
        raw_left, raw_right: the pictures as they came.
        pair: the rectified pair and its geometry.
        mask: (H, W) uint8 on the reference view, 1 where it was to be matched.
        disparity: the disparity map on the reference view.
        points: (H, W, 3) float32 in the pair's unit, frame of the rectified left camera; NaN where there is none.
        surface: the mesh of the map; smoothed: smoothed and decimated.
        mesh: the textured mesh.
        inputs: name and sha256 of each picture.
        options: every option as used.
        rig: of the raw pictures.
        checked: what matched features tell of it.
        found: how the rig was had, where it was made from this pair.
        seconds: wall time of each stage.
        warnings: what a person should know, one sentence each.
    """

    raw_left: Picture
    raw_right: Picture
    pair: RectifiedPair
    mask: Bytes
    disparity: Disparity
    points: Floats
    surface: Surface
    smoothed: Surface
    mesh: Mesh
    inputs: dict[str, dict[str, str]]
    options: dict[str, Any]
    rig: Rig
    checked: RigCheck
    seconds: dict[str, float]
    warnings: list[str]
    found: RigFound | None = None

    @property
    def picture(self) -> Picture:
        """The rectified picture of the reference view."""
        return self.pair.left if self.disparity.reference is View.LEFT else self.pair.right

    def save(
        self,
        folder: str | os.PathLike[str],
        *,
        texture_format: str = "png",
        quality: int | None = None,
        files: str = "all",
        also: dict[str, Any] | None = None,
    ) -> list[Path]:
        """Write every file of the result, all of them or none; returns their paths.

        These are model.glb, model.obj with .mtl and .png, model.ply, cloud.ply, surface.vtp, disparity.pfm and
        .png, report.html and result.json.

        Args:
            folder: is made if missing.
            texture_format: png, jpeg or webp: how model.glb holds its texture.
            quality: of JPEG and WebP, 1 to 100; None for 95.
            files: "all", or "model" for model.glb and result.json alone.
            also: entries for result.json besides.

        Raises:
            InputError: the folder cannot be made or written, or the format, quality or choice of files is unknown.
        """
        check_texture_format(texture_format, quality)
        if files not in ("all", "model"):
            raise InputError(f"files = {files!r:.60}: give all or model")
        with whole_folder(folder) as new:
            self.write_glb(new / "model.glb", texture_format=texture_format, quality=quality)
            if files == "all":
                self._write_rest(new)
            record = {**self.record(), **(also or {})}
            record["options"] = {**record["options"], "texture_format": texture_format}
            write_whole(new / "result.json", json.dumps(record, indent=1, allow_nan=False) + "\n")
            names = sorted(file.name for file in new.iterdir())
        return [Path(folder) / name for name in names]

    def _write_rest(self, new: Path) -> None:
        """Everything but the model and result.json: the report by this thread, the models meanwhile by another."""
        with ThreadPoolExecutor(1) as other:
            models = other.submit(self._write_models, new)
            write_report(
                new / "report.html",
                title=f"{self.inputs['left']['name']} and {self.inputs['right']['name']}",
                figures=self.figures(),
                facts=self._facts(),
                seconds=self.seconds,
                warnings=self.warnings,
                mesh=self.mesh,
            )
        models.result()

    def _write_models(self, new: Path) -> None:
        png = pack_texture(self.mesh.texture)
        export.write_obj(new / "model.obj", self.mesh, png=png)
        export.write_ply_mesh(new / "model.ply", self.mesh, png=png)
        export.write_ply(new / "cloud.ply", self.points, self._colours())
        export.write_vtp(new / "surface.vtp", self.mesh)
        export.write_pfm(new / "disparity.pfm", self.disparity.values)
        write_png(new / "disparity.png", figures.colour_disparity(self.disparity.values, bar=True))

    def write_glb(
        self, path: str | os.PathLike[str], *, texture_format: str = "png", quality: int | None = None
    ) -> Path:
        """Write the model alone, with the camera that its texture comes from; as `export.write_glb` says."""
        camera = standpoint(self.pair, self.disparity.reference)
        return export.write_glb(path, self.mesh, texture_format=texture_format, quality=quality, camera=camera)

    def record(self) -> dict[str, Any]:
        """What result.json holds: all that is needed to make this result again, and what came out."""
        values = self.disparity.values
        return {
            "package": _package(),
            "inputs": self.inputs,
            "options": self.options,
            "backend": self.disparity.backend,
            "device": self.disparity.device,
            "seconds": {**self.seconds, **{f"match: {name}": s for name, s in self.disparity.seconds.items()}},
            "geometry": {
                "focal_px": self.pair.focal_px,
                "baseline": self.pair.baseline,
                "unit": self.pair.unit,
                "cx_left": self.pair.cx_left,
                "cx_right": self.pair.cx_right,
                "cy": self.pair.cy,
            },
            "counts": {
                "pixels": int(values.size),
                "wanted": int((self.mask != 0).sum()),
                "with_disparity": int(np.isfinite(values).sum()),
                **{str(bit.name).lower(): int(((self.disparity.validity & bit) != 0).sum()) for bit in Validity},
                "open": int(((self.mask != 0) & np.isnan(self.disparity.values)).sum()),
                "matched_features": self.checked.matches,
                "undecimated_triangles": len(self.surface.faces),
                "vertices": len(self.mesh.vertices),
                "triangles": len(self.mesh.faces),
            },
            "coverage": self.disparity.coverage,
            "vertical_px": None if math.isnan(self.checked.vertical_px) else self.checked.vertical_px,
            "check": self.checked.record(),
            "rig_from_pair": None if self.found is None else self.found.record(),
            "warnings": self.warnings,
        }

    def figures(self) -> list[Figure]:
        """The pictures of the paper's figures 6 to 9 for this pair."""
        lines = draw_epipolar_curves(
            self.raw_left, self.raw_right, self.rig, self.checked.points_left, self.checked.points_right
        )
        device = open_backend(self.disparity.backend)
        still, film = page_film(self.mesh, device=device)
        unwanted = "nothing was masked" if self.mask.all() else "what is pale was not matched"
        return [
            Figure(
                name="Originals",
                caption="The two pictures as the cameras took them.",
                picture=figures.side_by_side(self.raw_left, self.raw_right),
            ),
            Figure(
                name="Epipolar lines",
                caption="Some matched features, and in the same colour the line on which the rig puts the partner in"
                " the other picture.",
                picture=figures.side_by_side(*lines),
            ),
            Figure(
                name="Check",
                caption="Where in the left picture the rig puts matched features on different rows, and by how much.",
                picture=draw_check(self.raw_left, self.checked),
            ),
            Figure(
                name="Rectified",
                caption="Undistorted and turned, so that every point lies on the same row in both:"
                " follow a level line.",
                picture=figures.side_by_side(self.pair.left, self.pair.right, level_lines=True),
            ),
            Figure(
                name="Masked",
                caption=f"The {self.disparity.reference} view; {unwanted}.",
                picture=figures.masked(self.picture, self.mask),
            ),
            Figure(
                name="Disparity",
                caption="How far each pixel moves between the views, px: what is near moves far.",
                picture=figures.colour_disparity(self.disparity.values, bar=True),
            ),
            Figure(
                name="Validity",
                caption="Why pixels have no disparity, and which were filled in.",
                picture=figures.colour_validity(self.disparity.validity),
            ),
            Figure(
                name="Confidence",
                caption="From 0, black, to 1.",
                picture=figures.colour_confidence(self.disparity.confidence),
            ),
            Figure(
                name="Cloud",
                caption="Every pixel at its depth, seen from the side.",
                picture=render_points(self.points, self._colours(), yaw=YAW, pitch=PITCH),
            ),
            Figure(
                name="Mesh",
                caption=f"{len(self.surface.faces):,} triangles, as it comes from the disparity map.",
                picture=render(self.surface, shading=Shading.WIRE, yaw=YAW, pitch=PITCH, device=device),
            ),
            Figure(
                name="Smoothed",
                caption=f"{len(self.smoothed.faces):,} triangles after smoothing and decimation.",
                picture=render(self.smoothed, shading=Shading.PLAIN, yaw=YAW, pitch=PITCH, device=device),
            ),
            Figure(
                name="Textured",
                caption=f"With the {self.disparity.reference} picture as texture.",
                picture=render(self.mesh, yaw=YAW, pitch=PITCH, device=device),
            ),
            Figure(
                name="Turned",
                caption="From a camera that swings to and fro before it.",
                picture=still,
                film=film,
            ),
        ]

    def _colours(self) -> Bytes:
        """The reference picture as (H, W, 3) uint8, as bright as the texture."""
        raw = self.raw_left if self.disparity.reference is View.LEFT else self.raw_right
        picture = self.picture.astype(np.float32) * np.float32(grey_scale(raw))
        eight = np.clip(picture + 0.5, 0, 255).astype(np.uint8)
        return eight if eight.ndim == 3 else np.repeat(eight[..., None], 3, axis=2)

    def _facts(self) -> dict[str, str | dict[str, str]]:
        record, pair, unit = self.record(), self.pair, self.pair.unit
        depths = self.points[..., 2][np.isfinite(self.points[..., 2])]
        vertical = "not measured" if record["vertical_px"] is None else f"{record['vertical_px']:.2f} px"
        return {
            "Pictures": {
                f"{name} picture": f"{about['name']} (sha256 {about['sha256'][:12]}…)"
                for name, about in self.inputs.items()
            },
            "Geometry": {
                "Size": f"{pair.left.shape[1]} x {pair.left.shape[0]} px",
                "Focal length": f"{pair.focal_px:.2f} px{f' ({self.found.focal.source})' if self.found else ''}",
                "Baseline": f"{pair.baseline:.3f} {unit}",
                "Vertical error": f"{vertical} (median of {len(self.checked.vertical)} features)",
                "Rig": f"{self.checked.verdict}: {self.checked.says}",
            },
            "Result": {
                "Coverage": f"{record['coverage']:.1%} of the wanted pixels",
                "Depth": f"{np.percentile(depths, 1):.1f} to {np.percentile(depths, 99):.1f} {unit}",
                "Disparities searched": f"{self.disparity.smallest} to "
                f"{self.disparity.smallest + self.disparity.disparities - 1} px",
                "Triangles": f"{len(self.mesh.faces):,}",
                "Texture": f"{self.mesh.texture.shape[1]} x {self.mesh.texture.shape[0]} px",
            },
            "Options": {name: str(value) for name, value in self.options.items()},
            "Machine": {
                "Backend": self.disparity.backend,
                "Device": self.disparity.device,
                "Package": record["package"],
            },
        }


@cache  # looked up in files, which takes 3 ms
def _package() -> str:
    return f"stereo-gpu {version('stereo-gpu')}"
