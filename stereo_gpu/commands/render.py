"""Draw a model from any angle, or film it as it turns."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from stereo_gpu.commands.arguments import add_backend

YAW, PITCH = 20.0, 8.0
PICTURE, FILM = (1280, 960), (640, 480)  # px
SAMPLES = 3  # by as many, of each pixel: a picture that is looked at for long may take its time


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument("model", type=Path, help="a .glb: what `reconstruct` wrote, or another program")
    parser.add_argument(
        "--yaw",
        type=_angles,
        action="append",
        metavar="DEG",
        help=f"how far the camera walks to its right, degrees ({YAW:g}); several with commas, as --yaw=-20,0,20, or by"
        " naming it more than once",
    )
    parser.add_argument(
        "--pitch", type=_angles, action="append", metavar="DEG", help=f"how far it rises ({PITCH:g}); one, or one a yaw"
    )
    parser.add_argument("--size", type=_size, metavar="WxH", help="px; a picture has 1280x960, a film 640x480")
    parser.add_argument("--shading", default="texture", help="texture, plain or wire (%(default)s)")
    parser.add_argument(
        "--out", type=Path, metavar="FILE.png", help="picture to write; of several, FILE-1.png and so on"
    )
    film = parser.add_argument_group("film")
    film.add_argument("--turntable", type=Path, metavar="FILE", help="film to write, a .gif, .webp or .mp4")
    film.add_argument("--seconds", type=float, default=6.0, help="of one loop (%(default)s)")
    film.add_argument("--fps", type=float, default=15.0, help="pictures a second (%(default)s)")
    film.add_argument(
        "--swing",
        type=float,
        default=25.0,
        metavar="DEG",
        help="to either side of --yaw, here 0 by default; 360: all the way round (%(default)s)",
    )
    add_backend(parser)


def run(options: argparse.Namespace) -> None:
    """Draw every picture that was asked for."""
    from stereo_gpu.backends import open_backend
    from stereo_gpu.errors import InputError
    from stereo_gpu.images import write_png
    from stereo_gpu.progress import Progress
    from stereo_gpu.read_model import read_glb
    from stereo_gpu.render import LARGEST_SIDE, Renderer, bring_in_front
    from stereo_gpu.turntable import check_film, turntable

    if options.out is None and options.turntable is None:
        raise InputError("nothing to write: name a picture with --out, or a film with --turntable")
    yaws = [angle for some in options.yaw or () for angle in some]
    pitches = [angle for some in options.pitch or () for angle in some]
    views = pair_angles(yaws or [YAW], pitches or [PITCH])
    files = [] if options.out is None else name_pictures(options.out, len(views))
    if options.turntable is not None:
        if len(views) > 1:
            raise InputError(f"{len(views)} angles for one film: give --yaw and --pitch once, the middle of its swing")
        check_film(options.turntable, options.seconds, options.fps, options.swing)
    mesh = bring_in_front(read_glb(options.model))
    device = open_backend(options.backend)
    if files:
        size = options.size or PICTURE
        samples = max(1, min(SAMPLES, LARGEST_SIDE // max(size)))
        renderer = Renderer(mesh, size=size, shading=options.shading, supersample=samples, device=device)
        for file, view in zip(files, views, strict=True):
            write_png(file, renderer.draw(renderer.cameras([view])[0]))
            print(f"{file}: yaw {view[0]:g}, pitch {view[1]:g} degrees")
    if options.turntable is not None:
        with Progress() as progress:
            turntable(
                mesh,
                options.turntable,
                size=options.size or FILM,
                seconds=options.seconds,
                fps=options.fps,
                swing=options.swing,
                yaw=yaws[0] if yaws else 0.0,
                pitch=views[0][1],
                shading=options.shading,
                device=device,
                progress=progress.filmed,
            )
        written = options.turntable.stat().st_size
        print(f"{options.turntable}: {options.seconds:g} s, {written / 1e6:.3g} MB")


def pair_angles(yaws: list[float], pitches: list[float]) -> list[tuple[float, float]]:
    """(yaw, pitch) of every picture; one angle alone goes with all of the others.

    Raises:
        InputError: there are several of both, and not as many.
    """
    from stereo_gpu.errors import InputError

    if len(yaws) != len(pitches) and 1 not in (len(yaws), len(pitches)):
        raise InputError(
            f"{len(yaws)} of --yaw and {len(pitches)} of --pitch: give one of them once, or as many of both"
        )
    count = max(len(yaws), len(pitches))
    return list(zip(yaws * (count // len(yaws)), pitches * (count // len(pitches)), strict=True))


def name_pictures(out: Path, count: int) -> list[Path]:
    """The file of each picture.

    Raises:
        InputError: it is no .png, or cannot be written.
    """
    from stereo_gpu.errors import InputError
    from stereo_gpu.files import check_writable_file

    if out.suffix.lower() != ".png":
        raise InputError(f"{out}: unknown ending '{out.suffix}' of a picture: take .png")
    check_writable_file(out)
    return (
        [out] if count == 1 else [out.with_name(f"{out.stem}-{number}{out.suffix}") for number in range(1, count + 1)]
    )


def _angles(text: str) -> list[float]:
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or not all(-360 <= angle <= 360 for angle in found):
        raise argparse.ArgumentTypeError(f"{text!r}: give degrees from -360 to 360, several with commas between them")
    return found


def _size(text: str) -> tuple[int, int]:
    from stereo_gpu.images import SMALLEST_SIDE

    match = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text)
    size = (int(match[1]), int(match[2])) if match else (0, 0)
    if min(size) < SMALLEST_SIDE:
        raise argparse.ArgumentTypeError(
            f"{text!r}: give width x height in px, such as 1280x960, each at least {SMALLEST_SIDE}"
        )
    return size
