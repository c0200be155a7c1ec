"""Read a rig from a calibration file of any supported program; the format is found from the content."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.rig import FORMAT, Rig
from stereo_gpu.rig_files.draft import Draft, Size
from stereo_gpu.rig_files.json_tree import parse_json
from stereo_gpu.rig_files.judge import check_cameras, check_size, in_unit, refuse_nonsense, to_rig
from stereo_gpu.rig_files.kitti import read_kitti
from stereo_gpu.rig_files.mat_variables import is_mat
from stereo_gpu.rig_files.matlab import read_matlab
from stereo_gpu.rig_files.middlebury import read_middlebury
from stereo_gpu.rig_files.opencv import read_opencv
from stereo_gpu.rig_files.ros import is_ros, read_ros
from stereo_gpu.rig_files.source import LARGEST_FILE, Source, read_source
from stereo_gpu.rig_files.text_lines import parse_lines
from stereo_gpu.rig_files.tree import Tree
from stereo_gpu.rig_files.xml_tree import parse_xml
from stereo_gpu.rig_files.yaml_tree import parse_yaml
from stereo_gpu.types import METRES_PER_UNIT, Picture

Paths = str | os.PathLike[str]

# What a folder may hold in place of one file: the two cameras of ROS, or the two files of OpenCV's sample.
PAIRS = (("left", "right"), ("intrinsics", "extrinsics"))
SUFFIXES = (".yaml", ".yml", ".xml")
LINES = {
    "middlebury": re.compile(rb"^[ \t]*cam[01][ \t]*=", re.MULTILINE),
    "kitti": re.compile(rb"^[ \t]*(P[0-3]|[KDRTS]_\d\d|P_rect_\d\d)[ \t]*:[ \t]*[-+.\d]", re.MULTILINE),
}

logger = logging.getLogger(__name__)


def load_rig(
    *paths: Paths, size: Size | None = None, unit: str | None = None, cameras: tuple[int, int] | None = None
) -> Rig:
    """Read a rig: ours, or OpenCV's, the Matlab toolbox's, ROS's, Middlebury's or KITTI's calibration.

    Args:
        paths: one file; or two, those of the left and the right camera (ROS) or intrinsics and extrinsics (OpenCV);
            or a folder that holds left.yaml and right.yaml, or intrinsics.yml and extrinsics.yml.
        size: width and height of the pictures, px, where the format does not hold them. KITTI's raw calibration
            has two kinds of pictures, and this says which are meant.
        unit: of the rig's lengths: mm, cm, m or in. Where the file says its own, lengths are turned into this one;
            where it does not, they are taken to be in this one, in mm by default.
        cameras: KITTI's numbers of the left and the right camera; by default 2 and 3, or 0 and 1.

    Raises:
        InputError: a file is missing, of no known format, cut off, damaged or huge, or says what no rig can be.
    """
    check_size(size)
    check_cameras(cameras)
    rig = _load(paths, size, unit, cameras)[0]
    for name, found in (("left", rig.left.size), ("right", rig.right.size)):
        if size is not None and tuple(size) != tuple(found):
            raise InputError(
                f"{_named(paths)}: it is for {name} pictures of {found[0]} x {found[1]} px, not of {size[0]} x"
                f" {size[1]}: leave the size out, or take the file that belongs to those"
            )
    return rig


def load_rig_for(path: Paths, picture: Picture) -> Rig:
    """Read the rig of a raw picture, which tells the size where the file does not; a warning says so.

    Raises:
        InputError: as `load_rig`; whether a size that the file does hold is the picture's, `check_sizes` tells.
    """
    size = (picture.shape[1], picture.shape[0])
    rig, open_size = _load((path,), size, None, None)
    if open_size:
        logger.warning("%s does not say how large its pictures are: taken as %d x %d px", path, *size)
    return rig


def _load(
    paths: Sequence[Paths], size: Size | None, unit: str | None, cameras: tuple[int, int] | None
) -> tuple[Rig, bool]:
    """The rig, and whether its size comes from `size` alone."""
    if unit is not None and unit not in METRES_PER_UNIT:
        raise InputError(f"unit {unit!r:.40} is unknown: give one of {', '.join(METRES_PER_UNIT)}")
    files = _files(paths)
    sources = [read_source(file) for file in files]
    own = Rig.load(files[0]) if len(sources) == 1 and _is_own(sources[0].data) else None  # it names the file itself
    try:
        if own is not None:
            refuse_nonsense(own)
            return in_unit(own, unit), False
        draft = _read(sources, size, cameras)
        return in_unit(to_rig(draft, size, unit), unit), draft.left.size is None
    except InputError as error:
        raise InputError(f"{_named(files)}: {error}") from error


def _named(paths: Sequence[Paths]) -> str:
    return " and ".join(map(str, paths))


def _read(sources: Sequence[Source], size: Size | None, cameras: tuple[int, int] | None) -> Draft:
    """What the files say, whatever program wrote them."""
    for source in sources:
        if len(source.data) > LARGEST_FILE:
            raise InputError(f"it is larger than {LARGEST_FILE >> 20} MiB: is this a calibration file?")
    first = sources[0].data
    kind = next((name for name, lines in LINES.items() if lines.search(first)), "")
    if cameras is not None and kind != "kitti":
        raise InputError(f"cameras is {cameras}, which is for KITTI's files: leave it out")
    if len(sources) > 1 and (kind or is_mat(first) or any(_is_own(source.data) for source in sources)):
        raise InputError("one of them holds both cameras: give that one alone")
    if kind or is_mat(first):
        if is_mat(first):
            return read_matlab(first)
        values = parse_lines(first)
        return read_middlebury(values) if kind == "middlebury" else read_kitti(values, size, cameras)
    trees = [_tree(source, len(sources) > 1) for source in sources]
    if any(is_ros(tree) for tree in trees):
        if len(trees) != 2:
            raise InputError("it is ROS's file of one camera: give both, the left one first, or the folder of both")
        return read_ros(*trees)
    return read_opencv(trees)


def _tree(source: Source, named: bool) -> Tree:
    """A file as a tree, by how it begins."""
    begin = source.data.lstrip(b"\xef\xbb\xbf\xff\xfe \t\r\n\0")[:1]
    try:
        if begin == b"<":
            return parse_xml(source.data)
        if begin in (b"{", b"["):
            return parse_json(source.data)
        if b"\0" in source.data[:1024]:
            raise InputError("it is binary and of no known format: give a .json, .yml, .xml, .mat or .txt calibration")
        return parse_yaml(source.data)
    except InputError as error:
        raise InputError(f"in {source.name}: {error}" if named else str(error)) from error


def _files(paths: Sequence[Paths]) -> list[Path]:
    """The files that are meant."""
    if not 1 <= len(paths) <= 2:
        raise InputError(f"{len(paths)} calibration files were given: give one, or the two of a pair")
    files = [Path(path) for path in paths]
    if len(files) == 1 and files[0].is_dir():
        for pair in PAIRS:
            found = [next(_with_suffixes(files[0], name), None) for name in pair]
            if all(found):
                return [file for file in found if file is not None]
        raise InputError(f"{files[0]} is a folder without left.yaml and right.yaml: name the calibration file in it")
    return files


def _with_suffixes(folder: Path, name: str) -> Iterator[Path]:
    return (folder / f"{name}{suffix}" for suffix in SUFFIXES if (folder / f"{name}{suffix}").is_file())


def _is_own(data: bytes) -> bool:
    """Whether this is what `Rig.save` writes; other JSON may be OpenCV's, or a student's with the same names."""
    return data.lstrip()[:1] == b"{" and FORMAT.encode() in data
