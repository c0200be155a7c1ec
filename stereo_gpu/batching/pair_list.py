"""Which pairs a folder or a manifest names."""

from __future__ import annotations

import csv
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereo_gpu.errors import InputError
from stereo_gpu.images import PICTURE_SUFFIXES
from stereo_gpu.recording.pair_folder import LIST_NAME

SIDES = ("left", "right")
COLUMNS = ("left", "right", "name", "mask")
FAILED_NAME = "failed.jsonl"  # stands beside the folders of the pairs
LONGEST_NAME = 200  # bytes, which leaves room for what a hidden name adds


@dataclass(frozen=True, kw_only=True)
class ListedPair:
    """A pair by its files; they need not exist.

    Args:
        name: of the pair, and of the folder of its result.
        left, right: the raw pictures.
        mask: picture, black where the rectified reference view is not wanted; None for none.
    """

    name: str
    left: Path
    right: Path
    mask: Path | None = None


def list_pairs(source: str | os.PathLike[str]) -> list[ListedPair]:
    """Find the pairs of a folder or a manifest, in order.

    A folder is what `capture` left (pairs.jsonl, or left0001.png, right0001.png and so on), has folders left and right
    with files of the same names, or a folder a pair, each with a picture left* and one right*. A manifest is CSV
    (columns left, right and, if wanted, name and mask) or JSON lines with these keys; its paths count from its folder.
    A pair without a name takes that of its left picture, less "left".

    Raises:
        InputError: there is no such file or folder, it names no pair, a line is wrong, or two pairs have one name.
    """
    path = Path(source)
    try:
        if path.is_dir():
            listed = path / LIST_NAME
            pairs = _from_manifest(listed) if listed.is_file() else _from_folder(path)
        else:
            pairs = _from_manifest(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}; check the path") from error
    if not pairs:
        raise InputError(f"{path} names no pair: it needs left and right pictures; see `stereo-gpu batch --help`")
    again = [name for name, count in Counter(pair.name for pair in pairs).items() if count > 1]
    if again:
        raise InputError(f"{path} has two pairs of the name {again[0]!r}: give each its own in a manifest")
    return pairs


def _from_folder(folder: Path) -> list[ListedPair]:
    if all((folder / side).is_dir() for side in SIDES):
        views = [{_common(file): file for file in _pictures(folder / side)} for side in SIDES]
        homes = [folder / side for side in SIDES]
    else:
        found = _pictures(folder)
        views = [{_common(file): file for file in found if file.name.lower().startswith(side)} for side in SIDES]
        homes = [folder, folder]
        if not any(views):
            return list(_from_folders(folder))
    # A picture without a partner is a pair that fails, rather than one that is lost without a word.
    for own, other, side in ((0, 1, SIDES[1]), (1, 0, SIDES[0])):
        for common, file in views[own].items():
            views[other].setdefault(common, homes[other] / _of_other_side(file.name, side))
    return [
        ListedPair(name=_name(None, views[0][common]), left=views[0][common], right=views[1][common])
        for common in sorted(views[0], key=lambda common: views[0][common].name)
    ]


def _from_folders(folder: Path) -> Iterator[ListedPair]:
    """A folder a pair."""
    for part in sorted(entry for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith(".")):
        sides = [[file for file in _pictures(part) if file.name.lower().startswith(side)] for side in SIDES]
        if len(sides[0]) == len(sides[1]) == 1:
            yield ListedPair(name=part.name, left=sides[0][0], right=sides[1][0])


def _pictures(folder: Path) -> list[Path]:
    return sorted(file for file in folder.iterdir() if file.suffix.lower() in PICTURE_SUFFIXES and file.is_file())


def _common(file: Path) -> str:
    """What the names of a pair's pictures have in common."""
    stem = file.stem
    for side in SIDES:
        if stem.lower().startswith(side):
            stem = stem[len(side) :]
        elif stem.lower().endswith(side):
            stem = stem[: -len(side)]
    return stem.strip("_-. ")


def _of_other_side(name: str, side: str) -> str:
    """What the partner of a picture would be called."""
    mine = SIDES[1 - SIDES.index(side)]
    return side + name[len(mine) :] if name.lower().startswith(mine) else name


def _name(given: str | None, left: Path) -> str:
    # left.png alone says nothing, the folder that it lies in does.
    return given or _common(left) or left.absolute().parent.name


def _from_manifest(path: Path) -> list[ListedPair]:
    try:
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text in UTF-8: give a folder, or a manifest as CSV or JSON lines") from error
    lines = text.splitlines()
    first = next((line for line in lines if line.strip()), "").lstrip()
    is_json = first.startswith("{") or path.suffix.lower() in (".json", ".jsonl")
    read = _json_lines if is_json else _csv_lines
    return [_pair(path, number, fields) for number, fields in read(path, lines)]


def _json_lines(path: Path, lines: list[str]) -> Iterator[tuple[int, dict[str, Any]]]:
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            fields = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}, line {number} is no JSON ({error}): mend or remove it") from error
        if not isinstance(fields, dict):
            raise InputError(f'{path}, line {number} is {line:.60}: give {{"left": ..., "right": ...}}')
        yield number, fields


def _csv_lines(path: Path, lines: list[str]) -> Iterator[tuple[int, dict[str, Any]]]:
    columns: Iterable[str] = COLUMNS
    reader = csv.reader(lines, skipinitialspace=True, strict=True)
    try:
        for number, row in enumerate(reader, 1):
            cells = [cell.strip() for cell in row]
            if number == 1 and {cell.lower() for cell in cells} >= set(SIDES):
                columns = [cell.lower() for cell in cells]
            elif any(cells):
                yield number, dict(zip(columns, cells, strict=False))
    except csv.Error as error:
        at = f"{path}, line {reader.line_num}"
        raise InputError(f"{at} is no CSV ({error}): give lines such as left1.png,right1.png") from error


def _pair(path: Path, number: int, fields: dict[str, Any]) -> ListedPair:
    for key in COLUMNS:
        value = fields.get(key)
        if not (value is None or isinstance(value, str)) or (key in SIDES and not value):
            raise InputError(
                f"{path}, line {number} has {key} = {value!r:.60}: give the file of each side, as left.png,right.png"
            )
        if isinstance(value, str) and "\0" in value:
            raise InputError(f"{path}, line {number}: {key} holds a zero byte; write it again")
    left, right = (path.parent / fields[side] for side in SIDES)
    name = _name(fields.get("name"), left)
    if not _is_name(name):
        raise InputError(f"{path}, line {number}: {name!r:.60} cannot be a folder's name; give another one")
    mask = fields.get("mask")
    return ListedPair(name=name, left=left, right=right, mask=path.parent / mask if mask else None)


def _is_name(name: str) -> bool:
    """Whether a pair's folder may be called so, and is then seen."""
    try:
        size = len(os.fsencode(name))
    except UnicodeEncodeError:
        return False
    taken = name.startswith(".") or name == FAILED_NAME
    return size <= LONGEST_NAME and not taken and not set(name) & set("/\\:\n")
