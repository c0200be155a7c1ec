"""Draw a run of the benchmark: a roofline, speeds and ratios as PNG, and one page that opens offline."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from stereo_gpu.bench.figures import INK, draw_peers, draw_speed
from stereo_gpu.bench.page import page
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.roofline import draw_roofline
from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.files import whole_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FONT = {"font.size": 9.5, "axes.titlesize": 10.5, "axes.titleweight": "bold", "text.color": INK}


def check_plotting() -> None:
    """Refuse to plot where matplotlib is missing, before anything is timed.

    Raises:
        StereoError: with the command that mends it.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise StereoError(
            f"--plot needs matplotlib, which cannot be loaded ({error}): pip install 'stereo-gpu[plot]'"
        ) from error


def write_plots(run: BenchRun, folder: Path) -> list[Path]:
    """Write roofline.png, speed.png, peers.png and bench.html, all of them or none.

    A picture for which the run holds nothing is left out.

    Raises:
        StereoError: matplotlib is missing.
        InputError: the folder cannot be written, or the run holds nothing to draw.
    """
    check_plotting()
    import matplotlib as mpl

    with mpl.rc_context(FONT):
        drawn = {"roofline": draw_roofline(run), "speed": draw_speed(run), "peers": draw_peers(run)}
        pictures = {name: _png(figure) for name, figure in drawn.items() if figure is not None}
    if not pictures:
        raise InputError("nothing in this run can be drawn: time kernels, profiles or matchers")
    with whole_folder(folder) as new:
        for name, picture in pictures.items():
            (new / f"{name}.png").write_bytes(picture)
        (new / "bench.html").write_text(page(run, pictures), "utf-8")
    return [folder / f"{name}.png" for name in pictures] + [folder / "bench.html"]


def _png(figure: Figure) -> bytes:
    held = io.BytesIO()
    figure.savefig(held, format="png", metadata={"Software": "stereo-gpu bench"})
    return held.getvalue()
