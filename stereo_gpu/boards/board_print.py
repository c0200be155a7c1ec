"""Print a board in true size: as PDF, or as PNG with its resolution."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.board_drawing import cells_across
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.boards.sheet import FIT, MILLIMETRES, Sheet, Words, lay_out
from stereo_gpu.errors import InputError
from stereo_gpu.files import write_whole
from stereo_gpu.types import Bytes, Doubles

POINT = 25.4 / 72  # mm
USUAL_DOTS = 300 / 25.4  # a mm
FEWEST_DOTS = 2.0  # a mm; below that, edges are ragged
MOST_PIXELS = 60_000_000  # of a PNG
CAP_HEIGHT = 0.72  # of a line's height


@dataclass(frozen=True, kw_only=True)
class PrintedBoard:
    """What was written.

    Args:
        path: the file.
        width_mm, height_mm: of the page.
        dots_per_mm: of a PNG; None for a PDF, which has no dots.
        largest_error_mm: by how much a side of a marker in the file differs from the true one.
    """

    path: Path
    width_mm: float
    height_mm: float
    dots_per_mm: float | None = None
    largest_error_mm: float = 0.0


def print_board(board: Board, path: str | os.PathLike[str], *, paper: str = FIT) -> PrintedBoard:
    """Write a board as a page that is printed in true size.

    Below the board stand a ruler of 100 mm, or as many whole centimetres as fit, and the board's name.

    Args:
        board: what to print; its unit must be mm, cm, m or in.
        path: ends in .pdf or .png. In a PNG each square has a whole number of dots, and the file says how many
            dots a metre has.
        paper: a0 to a5, letter, legal or tabloid; or "fit", a page as large as the board needs.

    Raises:
        InputError: the path, the paper or the unit is wrong, the board does not fit, or the file cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in (".pdf", ".png"):
        raise InputError(f"cannot print to {path}: name a file that ends in .pdf or .png")
    sheet = lay_out(board, paper)
    if kind == ".pdf":
        write_whole(path, as_pdf(sheet, f"{board.columns} x {board.rows} squares"))
        return PrintedBoard(path=path, width_mm=sheet.width, height_mm=sheet.height)
    dots = choose_dots(board, sheet)
    picture = rasterise(sheet, dots)
    write_whole(path, as_png(picture, dots))
    return PrintedBoard(
        path=path,
        width_mm=picture.shape[1] / dots,
        height_mm=picture.shape[0] / dots,
        dots_per_mm=dots,
        largest_error_mm=_marker_error(board, dots),
    )


def choose_dots(board: Board, sheet: Sheet) -> float:
    """Dots a mm for which a square has a whole number of them, and so has a marker's cell as nearly as can be.

    Raises:
        InputError: so large a sheet cannot be drawn finely enough.
    """
    square = board.square * MILLIMETRES[board.unit]
    wanted = min(USUAL_DOTS, math.sqrt(MOST_PIXELS / (sheet.width * sheet.height)))
    if wanted < FEWEST_DOTS:
        raise InputError(
            f"a page of {sheet.width:.0f} x {sheet.height:.0f} mm has too many dots for a PNG: name a file that ends"
            " in .pdf"
        )
    if wanted * square < max(2, cells_across(board)):
        raise InputError(f"squares of {square:g} mm are too small for the dots of a PNG: name a file that ends in .pdf")
    counts = np.arange(max(1, math.floor(0.8 * wanted * square)), math.ceil(1.05 * wanted * square) + 1)
    off = [round(_marker_error(board, count / square), 4) for count in counts]
    # pHYs counts whole dots a metre.
    metre = [
        round(abs(1000 * count / square - round(1000 * count / square)) / (1000 * count / square), 5)
        for count in counts
    ]
    far = np.abs(counts - wanted * square)
    best = min(range(len(counts)), key=lambda number: (off[number], metre[number], far[number]))
    return float(counts[best] / square)


def rasterise(sheet: Sheet, dots: float) -> Bytes:
    """The page as a picture, 0 or 255, with `dots` a mm; the board's squares begin at a whole dot."""
    width, height = math.ceil(sheet.width * dots), math.ceil(sheet.height * dots)
    page = np.full((height, width), 255, np.uint8)
    shift = np.round(np.array(sheet.origin) * dots) - np.array(sheet.origin) * dots
    for rectangles, offset in ((sheet.board, shift), (sheet.ruler, shift)):
        ends = np.hstack([rectangles[:, :2], rectangles[:, :2] + rectangles[:, 2:]]) * dots + np.tile(offset, 2)
        for left, top, right, bottom in np.round(ends).astype(int).tolist():
            page[top : max(bottom, top + 1), left : max(right, left + 1)] = 0
    for words in sheet.words:
        _write(page, words, dots)
    return page


def as_png(picture: Bytes, dots: float) -> bytes:
    """A black and white PNG that says how large it is."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(picture).convert("1", dither=Image.Dither.NONE).save(
        stream, "PNG", dpi=(dots * 25.4, dots * 25.4), optimize=True
    )
    return stream.getvalue()


def as_pdf(sheet: Sheet, title: str) -> bytes:
    """A PDF of one page with the board as rectangles, so that its edges are as sharp as the printer is.

    Pillow would write it as a picture, whose dots the printer then spreads over its own.
    """
    flip = sheet.height
    drawn = ["0 g"]
    for rectangles in (sheet.board, sheet.ruler):
        # One path, so that rectangles that touch show no seam.
        drawn += [
            f"{x / POINT:.4f} {(flip - y - h) / POINT:.4f} {w / POINT:.4f} {h / POINT:.4f} re"
            for x, y, w, h in rectangles.tolist()
        ]
        drawn.append("f")
    drawn += [
        f"BT /F1 {words.size / POINT:.3f} Tf {words.x / POINT:.3f} {(flip - words.y) / POINT:.3f} Td"
        f" ({_escaped(words.text)}) Tj ET"
        for words in sheet.words
    ]
    content = "\n".join(drawn).encode("ascii")
    page = (
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {sheet.width / POINT:.4f} {sheet.height / POINT:.4f}]"
        " /Resources << /Font << /F1 5 0 R >> >> /Contents 4 0 R >>"
    )
    return _joined(
        [
            # PrintScaling is what viewers offer first when they print.
            b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
            b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            page.encode("ascii"),
            b"<< /Length %d >>\nstream\n%b\nendstream" % (len(content), content),
            b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
            f"<< /Title ({_escaped(title)}) /Producer (stereo-gpu) >>".encode("ascii"),
        ]
    )


def _joined(objects: Iterable[bytes]) -> bytes:
    """A PDF file of these objects: the first is the catalogue, the last one what it is about."""
    file = bytearray(b"%PDF-1.6\n%\xe2\xe3\xcf\xd3\n")
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(file))
        file += b"%d 0 obj\n%b\nendobj\n" % (number, body)
    start = len(file)
    file += b"xref\n0 %d\n0000000000 65535 f \n" % (len(places) + 1)
    file += b"".join(b"%010d 00000 n \n" % place for place in places)
    file += b"trailer\n<< /Size %d /Root 1 0 R /Info %d 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        len(places) + 1,
        len(places),
        start,
    )
    return bytes(file)


def _escaped(text: str) -> str:
    return text.encode("ascii", "replace").decode().replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")


def _write(page: Bytes, words: Words, dots: float) -> None:
    font, thickness = cv2.FONT_HERSHEY_SIMPLEX, max(1, round(words.size * dots * 0.09))
    scale = cv2.getFontScaleFromHeight(font, max(4, round(words.size * dots * CAP_HEIGHT)), thickness)
    at = round(words.x * dots), round(words.y * dots)
    cv2.putText(page, words.text, at, font, scale, 0, thickness, cv2.LINE_8)


def _marker_error(board: Board, dots: float) -> float:
    """By how many mm a marker's edge or cell may be off when drawn in whole dots."""
    if not isinstance(board, CharucoBoard):
        return 0.0
    square, marker = (side * MILLIMETRES[board.unit] * dots for side in (board.square, board.marker))
    edges: Doubles = (square - marker) / 2 + marker * np.linspace(0, 1, cells_across(board) + 1)
    return float(np.abs(edges - np.round(edges)).max() / dots)
