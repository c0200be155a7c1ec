"""Hold a disparity map, or what a profile makes of a rectified pair, against its truth.

    tools/evaluate map.pfm truth.png --truth-scale 4
    tools/evaluate --left left.png --right right.png --truth truth.pfm --profile precise --pictures out
    tools/evaluate --self-test

Maps, truths: PFM, .npy, .npz, pictures of 16 bits (KITTI: 256 a px) or of 8 bits (Middlebury: give the scale).
"""

import argparse
import json
import logging
import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.evaluation.classes import CLASSES, find_classes
from stereo_gpu.evaluation.figures import colour_errors, colour_masks, colour_pair, draw_sparsification
from stereo_gpu.evaluation.masks import read_mask
from stereo_gpu.evaluation.scores import Mask, score, size
from stereo_gpu.evaluation.sparsification import Sparsification, sparsify
from stereo_gpu.evaluation.table import confidence_lines, score_lines
from stereo_gpu.evaluation.truth import read_confidence, read_disparity, read_truth
from stereo_gpu.figures import colour_confidence
from stereo_gpu.files import check_writable, check_writable_file, whole_folder, write_whole
from stereo_gpu.images import read_image, write_png
from stereo_gpu.match import match
from stereo_gpu.match_options import parse_view
from stereo_gpu.types import Floats

ROOT = Path(__file__).parents[1]
# The map that PatchMatch Stereo submitted: scale, and Middlebury's bad-1.0 on nonocc, all and disc, per cent.
PUBLISHED = {"teddy": (4, (2.99, 8.16, 9.62)), "tsukuba": (16, (2.09, 2.33, 9.31))}


@dataclass
class Map:
    """What is evaluated."""

    name: str
    values: Floats
    confidence: Floats | None = None
    facts: dict[str, Any] = field(default_factory=dict)


def main(arguments: list[str] | None = None) -> int:
    """Evaluate; the exit status is 0, 2 for wrong input, 1 for any other failure."""
    options = parse(arguments)
    try:
        return self_test() if options.self_test else evaluate(options)
    except StereoError as error:
        print("evaluate: error: " + " ".join(str(error).split()), file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1


def evaluate(options: argparse.Namespace) -> int:
    """Score one map, print the tables and write what is asked for."""
    view = parse_view(options.reference)
    if options.pictures:
        check_writable(options.pictures)
    if options.json:
        check_writable_file(options.json)
    truth = read_truth(options.truth, options.truth_scale)
    other = read_truth(options.truth_other, options.truth_scale) if options.truth_other else None
    if other is not None:
        fits(str(options.truth_other), other, truth)
    masks, notes = find_classes(truth, read_masks(options, truth), other=other, reference=view)
    found = matched(options, truth) if options.left else read_map(options, truth)
    scores = {name: score(found.values, truth, mask) for name, mask in masks.items()}
    print(found.name)
    for line in score_lines(scores):
        print(line)
    surest = None
    over = next((name for name, each in scores.items() if each.given), None)
    if found.confidence is not None and over:
        surest = sparsify(found.values, truth, found.confidence, masks[over])
        notes.append(f"the areas are those over {over}")
        for line in confidence_lines(surest):
            print(line)
    for note in notes:
        print(f"note: {note}")
    if options.pictures:
        draw(options.pictures, found, truth, masks, surest)
    if options.json:
        content = {"map": found.name, "truth": str(options.truth), **found.facts, "notes": notes}
        content["scores"] = {name: each.as_dict() for name, each in scores.items()}
        if surest:
            content["sparsification"] = {"over": over, "bad": surest.bad.as_dict(), "mean": surest.mean.as_dict()}
        write_whole(options.json, json.dumps(content, indent=1, allow_nan=False) + "\n")
    return 0


def read_map(options: argparse.Namespace, truth: Floats) -> Map:
    """The map that is named, and its confidence if there is a file of it."""
    found = Map(str(options.map), read_disparity(options.map, options.scale))
    fits(found.name, found.values, truth)
    if options.confidence:
        found.confidence = read_confidence(options.confidence)
        fits(str(options.confidence), found.confidence, truth)
    return found


def matched(options: argparse.Namespace, truth: Floats) -> Map:
    """The map that a profile makes of the pair."""
    left, right = read_image(options.left), read_image(options.right)
    fits(str(options.left), left[..., 0] if left.ndim == 3 else left, truth)
    disparity = match(
        left,
        right,
        disparities=options.disparities,
        window=options.window,
        reference=options.reference,
        profile=options.profile,
        backend=options.backend,
    )
    seconds = sum(disparity.seconds.values())
    searched = [disparity.smallest, disparity.disparities]
    facts = {"left": str(options.left), "right": str(options.right), "reference": options.reference}
    facts |= {"profile": options.profile, "disparities": searched, "backend": disparity.backend, "seconds": seconds}
    last = disparity.smallest + disparity.disparities - 1
    name = f"{options.profile}, searched {searched[0]} to {last} px in {seconds:.2f} s on {disparity.backend}"
    return Map(name, disparity.values, disparity.confidence, facts)


def read_masks(options: argparse.Namespace, truth: Floats) -> dict[str, Mask]:
    """The masks that are named, by class."""
    masks = {}
    for name in CLASSES:
        if path := getattr(options, name):
            masks[name] = read_mask(path)
            fits(str(path), masks[name], truth)
            if not (masks[name] & np.isfinite(truth)).any():
                raise InputError(f"{path} counts no pixel whose truth is known: give another mask")
    return masks


def fits(name: str, array: np.ndarray, truth: Floats) -> None:
    """Refuse what is not of the truth's size."""
    if array.shape != truth.shape:
        raise InputError(f"{name} is {size(array)}, the truth is {size(truth)}: give two of one size")


def draw(folder: Path, found: Map, truth: Floats, masks: dict[str, Mask], surest: Sparsification | None) -> None:
    """Write the pictures, all or none."""
    disparity, true = colour_pair(found.values, truth)
    pictures = {"disparity": disparity, "truth": true}
    for name, mask in masks.items():
        if name != "disc":
            pictures[f"errors_{name}"] = colour_errors(found.values, truth, mask)
    if "nonocc" in masks:
        pictures["masks"] = colour_masks(truth, masks["nonocc"], masks.get("disc", np.zeros(truth.shape, bool)))
    if found.confidence is not None:
        pictures["confidence"] = colour_confidence(found.confidence)
    if surest:
        pictures["sparsification"] = draw_sparsification(surest.bad, name="bad-1.0")
    with whole_folder(folder) as new:
        for name, picture in pictures.items():
            write_png(new / f"{name}.png", picture)


def self_test() -> int:
    """Score the map that PatchMatch Stereo submitted to Middlebury; 1 if a figure is not the published one."""
    folder = Path(os.environ.get("STEREO_GPU_DATA", ROOT.parent / "shared" / "data")) / "stereo"
    wrong = 0
    for pair, (scale, published) in PUBLISHED.items():
        if not (folder / pair).is_dir():
            raise InputError(f"{folder} holds no {pair}: set STEREO_GPU_DATA to the folder of real data")
        values = read_disparity(folder / pair / "alg117.png", scale)
        truth = read_truth(folder / pair / "groundtruth.png", scale)
        masks = [read_mask(folder / pair / f"{name}.png") for name in CLASSES]
        found = tuple(round(100 * score(values, truth, mask).bad[1.0], 2) for mask in masks)
        wrong += found != published
        figures = " / ".join(f"{share:.2f}" for share in found)
        verdict = "as published" if found == published else f"published: {' / '.join(map(str, published))}"
        print(f"{pair}, alg117.png, bad-1.0 over nonocc / all / disc: {figures} %, {verdict}")
    return 1 if wrong else 0


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Print the message and end with status 2."""
        print(f"evaluate: error: {message}; see tools/evaluate --help", file=sys.stderr)
        sys.exit(2)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Read the arguments, and refuse those that do not go together."""
    about, _, usage = __doc__.partition("\n\n")
    parser = Parser(
        prog="tools/evaluate", description=about, epilog=usage, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("map", type=Path, nargs="?", metavar="MAP", help="disparity map")
    parser.add_argument("positional", type=Path, nargs="?", metavar="TRUTH", help="its truth")
    parser.add_argument("--scale", type=float, help="what MAP holds for one px")
    parser.add_argument("--truth-scale", type=float, metavar="SCALE", help="what the truth holds for one px")
    parser.add_argument("--left", type=Path, metavar="FILE", help="left picture: match this pair in place of a MAP")
    parser.add_argument("--right", type=Path, metavar="FILE", help="right picture")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="truth of the pair, on the reference view")
    parser.add_argument("--profile", default="precise", help="paper, fast or precise (%(default)s)")
    parser.add_argument(
        "--disparities", type=disparities, default="auto", metavar="SMALLEST,COUNT", help="px, or auto (%(default)s)"
    )
    parser.add_argument("--window", type=window, metavar="PX", help="px or auto; by default the profile's")
    parser.add_argument("--backend", help="where to compute, as `stereo-gpu devices` names it")
    parser.add_argument("--reference", default="left", help="the view that map and truth show (%(default)s)")
    parser.add_argument(
        "--truth-other", type=Path, metavar="FILE", help="truth of the other view: tells what is occluded"
    )
    for name, counts in (("nonocc", "non-occluded pixels"), ("all", "all pixels"), ("disc", "pixels near jumps")):
        text = f"mask, {counts} are 255; by default computed from the truth"
        parser.add_argument(f"--{name}", type=Path, metavar="FILE", help=text)
    parser.add_argument(
        "--confidence", type=Path, metavar="FILE", help="how sure MAP is: PFM, .npy, .npz, grey picture"
    )
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="folder for pictures to look at")
    parser.add_argument("--json", type=Path, metavar="FILE", help="file for all figures")
    parser.add_argument("--self-test", action="store_true", help="score a submission whose scores Middlebury published")
    options = parser.parse_args(arguments)
    named = [name for name in ("map", "left", "right", "truth") if getattr(options, name)]
    if options.self_test and not named:
        return options
    if options.positional and not options.truth:
        options.truth = options.positional
        named.append("truth")
    elif options.positional:
        parser.error(f"{options.positional} and {options.truth} are two truths: give one")
    if named not in (["map", "truth"], ["left", "right", "truth"]) or options.self_test:
        parser.error("give MAP and TRUTH, or --left, --right and --truth, or --self-test alone")
    if options.left:
        for name in ("scale", "confidence"):
            if getattr(options, name) is not None:
                parser.error(f"--{name} belongs to a MAP, and here a pair is matched: leave it out")
    return options


def disparities(text: str) -> str | tuple[int, int]:
    """The range to search, or auto."""
    if text == "auto":
        return text
    try:
        smallest, count = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither auto nor two whole numbers such as 0,64") from None
    return smallest, count


def window(text: str) -> str | int:
    """The side of the window, or auto."""
    if text == "auto":
        return text
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is neither auto nor a whole number such as 9") from None


if __name__ == "__main__":
    logging.basicConfig(format="evaluate: %(levelname)s: %(message)s", level=logging.WARNING)
    sys.exit(main())
