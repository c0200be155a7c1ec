"""One HTML file that shows a whole calibration and opens offline: advice, errors, coverage, lenses, space, views."""

from __future__ import annotations

import os
from html import escape
from pathlib import Path
from string import Template

from stereo_gpu.calibration.figures.alone import style_sheet
from stereo_gpu.calibration.figures.coverage import draw_coverage, measure_coverage
from stereo_gpu.calibration.figures.lens import draw_distortion, draw_radial
from stereo_gpu.calibration.figures.residuals import draw_field, draw_scatter, pooled_residuals, scatter_reach
from stereo_gpu.calibration.figures.space import draw_space
from stereo_gpu.calibration.figures.tables import lens_models_card, parameter_tables, summary_tiles
from stereo_gpu.calibration.figures.views import draw_bars, draw_views
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.files import write_whole

SIDES = ("left", "right")
NEXT = "next:"  # how the advice opens that tells which view to take


def write_calibration_report(calibration: Calibration, path: str | os.PathLike[str]) -> Path:
    """Write the report to `path`, whole or not at all, and return the path.

    The file stays small whatever the number of views: all of them are in the table of errors, the figures thin out
    what they draw and say so.

    Args:
        calibration: what `calibrate_in_full` gave.
        path: the HTML file to write; its folder must exist.

    Raises:
        InputError: the file cannot be written.
    """
    here = Path(__file__).parent
    page = Template((here / "report.html").read_text(encoding="utf-8"))
    rig, board = calibration.rig, calibration.board
    cameras = (rig.left, rig.right)
    coverages = measure_coverage(calibration)
    left, right = (pooled_residuals(calibration, side) for side in (0, 1))
    reach = scatter_reach((left, right))
    views, views_told = draw_views(calibration)
    space, space_told = draw_space(calibration)
    radial, radial_told = draw_radial(cameras, (left, right))
    both = list(zip(SIDES, cameras, (left, right), strict=True))
    content = page.substitute(
        style=style_sheet(),
        script=(here / "figures" / "turn.js").read_text(encoding="utf-8"),
        lead=escape(_lead(calibration)),
        tiles=summary_tiles(calibration, (coverages[0].share, coverages[1].share)),
        advice=_advice(calibration.advice),
        bars=draw_bars(calibration),
        residuals="".join(
            [
                *(
                    _figure(f"{side.title()} residuals", *draw_scatter(residuals, side, reach))
                    for side, _, residuals in both
                ),
                *(
                    _figure(f"{side.title()} mean residual by place", *draw_field(residuals, camera.size, side))
                    for side, camera, residuals in both
                ),
            ]
        ),
        coverage="".join(
            _figure(f"{side.title()} picture", drawing, told, escaped=True)
            for side, (drawing, told) in zip(
                SIDES, (draw_coverage(calibration, side, coverages) for side in (0, 1)), strict=True
            )
        ),
        lenses="".join(_figure(f"{side.title()} lens", *draw_distortion(camera, side)) for side, camera, _ in both)
        + _figure("Along the radius", radial, radial_told)
        + lens_models_card(calibration.models),
        space=space,
        space_told=escape(space_told),
        parameters=parameter_tables(calibration),
        views=views,
        views_told=escape(views_told),
        board=escape(f"{board.described}, {board.square:g} {board.unit} each"),
    )
    return write_whole(path, content)


def _lead(calibration: Calibration) -> str:
    rig, board = calibration.rig, calibration.board
    sizes = [f"{camera.size[0]} x {camera.size[1]} px" for camera in (rig.left, rig.right)]
    pictures = sizes[0] if sizes[0] == sizes[1] else f"{sizes[0]} left, {sizes[1]} right"
    return (
        f"{len(calibration.views)} pairs of a board of {board.described}, {board.square:g} {board.unit} each;"
        f" pictures of {pictures}; lenses with {len(rig.left.distortion)} coefficients"
    )


def _advice(advice: tuple[str, ...]) -> str:
    """Warnings, and then the next best view, each in a box of its own."""
    warnings = [words for words in advice if not words.startswith(NEXT)]
    following = [words.removeprefix(NEXT).strip() for words in advice if words.startswith(NEXT)]
    return _warnings(warnings) + "".join(
        f'<section class="next"><h2>Next best view</h2><p>{escape(words[:1].upper() + words[1:])}.</p></section>'
        for words in following
    )


def _warnings(warnings: list[str]) -> str:
    if not warnings:
        return '<p class="fine">No warnings.</p>'
    listed = "".join(f"<li>{escape(words)}</li>" for words in warnings)
    heading = "Warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    return f'<section class="warnings" role="alert"><h2>{heading}</h2><ul>{listed}</ul></section>'


def _figure(name: str, drawing: str, told: str, *, escaped: bool = False) -> str:
    words = told if escaped else escape(told)
    return f"<figure>{drawing}<figcaption><b>{escape(name)}.</b> {words}</figcaption></figure>"
