"""One HTML file that shows a whole reconstruction and opens offline: pictures, numbers, warnings, model."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template

import cv2
import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.figures import as_rgb
from stereo_gpu.files import write_whole
from stereo_gpu.types import Bytes, Mesh, Picture
from stereo_gpu.viewer import viewer_page

_WIDEST = 1600  # px: a picture wider than this is shrunk, or large cameras would make pages of 100 MB
_QUALITY = 90  # of JPEG
_FLAT, _SAMPLED = 100, 8000  # a drawing has at most so many colours, of so many pixels
_WHOLE_ROW = (1000, 1.7)  # width in px, and width against height, from which a picture takes the whole row


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A picture of the report.

    Args:
        name: a few words that say what it is.
        caption: what to look for in it.
        picture: uint8 or uint16, (H, W) or (H, W, 3) RGB.
        film: a WebP that moves in place of the picture, but on paper and for whoever wants less motion.
    """

    name: str
    caption: str
    picture: Picture
    film: bytes | None = None


def write_report(
    path: str | os.PathLike[str],
    *,
    title: str,
    figures: Sequence[Figure],
    facts: Mapping[str, str | Mapping[str, str]],
    seconds: Mapping[str, float],
    warnings: Sequence[str] = (),
    mesh: Mesh | None = None,
) -> Path:
    """Write the report to `path`, whole or not at all, and return the path.

    Args:
        path: the HTML file to write; its folder must exist.
        title: heading of the page.
        figures: in the order in which they are shown.
        facts: what was measured and used; a mapping within the mapping makes a section under its own heading.
        seconds: wall time of each stage, in the order in which they ran.
        warnings: one sentence each, shown before all else.
        mesh: the model to turn; None leaves the viewer out.

    Raises:
        InputError: the file cannot be written.
        PictureError: a figure is not a picture.
        StageError: the mesh has no faces.
    """
    page = Template(Path(__file__).with_name("report.html").read_text(encoding="utf-8"))
    content = page.substitute(
        style=Path(__file__).with_name("report.css").read_text(encoding="utf-8"),
        title=escape(title),
        warnings=_warnings(warnings),
        model="" if mesh is None else _model(mesh),
        figures=_figures(figures),
        numbers=_numbers(facts, seconds),
    )
    return write_whole(path, content)


def _warnings(warnings: Sequence[str]) -> str:
    if not warnings:
        return '<p class="fine">No warnings.</p>'
    items = "".join(f"<li>{escape(warning)}</li>" for warning in warnings)
    heading = "Warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
    return f'<section class="warnings" role="alert"><h2>{heading}</h2><ul>{items}</ul></section>'


def _model(mesh: Mesh) -> str:
    height, width = mesh.texture.shape[:2]
    low, high = np.nanpercentile(mesh.vertices, [1, 99], axis=0)
    extent = " × ".join(f"{value:,.0f}" for value in high - low)
    what = (
        f"{len(mesh.faces):,} triangles, {len(mesh.vertices):,} vertices, texture {width} × {height} px; "
        f"{extent} {mesh.unit} wide, high and deep. First seen as the cameras saw it. Drag to turn, wheel or "
        "pinch to zoom, right button or two fingers to move."
    )
    # Inside srcdoc only & and quotes have to be written as entities, and the page may hold anything else.
    # No sandbox: it would stop the model's texture in some browsers, and the page's Content-Security-Policy,
    # which the frame inherits, keeps both off the network.
    inner = viewer_page(mesh).replace("&", "&amp;").replace('"', "&quot;")
    return (
        '<h2>The model</h2>\n<div class="model"><iframe title="The textured model, to turn with the pointer" '
        f'srcdoc="{inner}"></iframe><p>{escape(what)}</p></div>'
    )


def _figures(figures: Sequence[Figure]) -> str:
    if not figures:
        return ""
    shown = "\n".join(_figure(number, figure) for number, figure in enumerate(figures, 1))
    return f'<h2>Step by step</h2>\n<div class="figures">\n{shown}\n</div>'


def _figure(number: int, figure: Figure) -> str:
    picture = as_rgb(figure.picture)
    kind, data = _encode(picture)
    height, width = picture.shape[:2]
    wide = ' class="wide"' if width >= max(_WHOLE_ROW[0], _WHOLE_ROW[1] * height) else ""
    name, caption = escape(figure.name), escape(figure.caption)
    shown = f'<img src="data:image/{kind};base64,{data}" alt="{name}: {caption}" width="{width}" height="{height}">'
    if figure.film is not None:
        moving = f"data:image/webp;base64,{base64.b64encode(figure.film).decode()}"
        media = "screen and (prefers-reduced-motion: no-preference)"
        shown = f'<picture><source type="image/webp" media="{media}" srcset="{moving}">{shown}</picture>'
    return f"<figure{wide}>{shown}<figcaption><b>{number}. {name}.</b> {caption}</figcaption></figure>"


def _encode(picture: Bytes) -> tuple[str, str]:
    """As base64: photographs become JPEG; drawings with a few flat colours PNG, if that is the smaller one.

    Nothing else is tried as PNG, which takes 30 times as long as JPEG.
    """
    height, width = picture.shape[:2]
    if width > _WIDEST:
        size = (_WIDEST, max(1, round(height * _WIDEST / width)))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    bgr = np.ascontiguousarray(picture[..., ::-1])
    whole = [cv2.IMWRITE_JPEG_QUALITY, _QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111]
    choices = []
    some = bgr.reshape(-1, 3)[:: max(1, len(bgr) * bgr.shape[1] // _SAMPLED)].astype(np.uint32)
    flat = len(np.unique(some @ np.array([1, 256, 65536], np.uint32))) <= _FLAT
    forms = [("jpeg", whole), ("png", [cv2.IMWRITE_PNG_COMPRESSION, 6])]
    for kind, options in forms[: 1 + flat]:
        done, packed = cv2.imencode(f".{kind}", bgr, options)
        if not done:
            raise InputError(f"a picture of {width} x {height} px cannot be packed as {kind}: make it smaller")
        choices.append((len(packed), kind, packed.tobytes()))
    _, kind, data = min(choices)
    return kind, base64.b64encode(data).decode()


def _numbers(facts: Mapping[str, str | Mapping[str, str]], seconds: Mapping[str, float]) -> str:
    cards = []
    if seconds:
        cards.append(f'<section class="card"><h3>Seconds a stage</h3>{_seconds(seconds)}</section>')
    loose = {name: value for name, value in facts.items() if isinstance(value, str)}
    sections = {name: value for name, value in facts.items() if isinstance(value, Mapping)}
    for heading, section in (({"Facts": loose} if loose else {}) | sections).items():
        rows = "".join(
            f'<tr><th scope="row">{escape(str(name))}</th><td>{escape(str(value))}</td></tr>'
            for name, value in section.items()
        )
        cards.append(f'<section class="card"><h3>{escape(heading)}</h3><table class="facts">{rows}</table></section>')
    return f'<h2>Numbers</h2>\n<div class="pair">\n{"".join(cards)}\n</div>' if cards else ""


def _seconds(seconds: Mapping[str, float]) -> str:
    """A table with a bar for each stage, the longest stage's bar filling its column."""
    longest, total = max(seconds.values()), sum(seconds.values())
    rows = ""
    for stage, spent in seconds.items():
        share = 100 * spent / longest if longest > 0 else 0
        rows += (
            f'<tr><th scope="row">{escape(stage)}</th>'
            f'<td><span class="bar" style="width:{share:.1f}%"></span></td>'
            f'<td class="number">{spent:.2f} s</td></tr>'
        )
    return (
        f'<table class="seconds"><tbody>{rows}</tbody><tfoot><tr><th scope="row" colspan="2">All stages</th>'
        f'<td class="number">{total:.2f} s</td></tr></tfoot></table>'
    )
