"""What a GLB's surfaces are painted with, laid out on one sheet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.images import decode_image
from stereo_gpu.model_files.glb_file import GlbFile, as_object
from stereo_gpu.types import Bytes, Doubles, Floats

SIDE_LIMIT = 16_384  # px of the sheet
CLAY = (196, 192, 184)
_GUTTER = 2  # px around each picture, so that none bleeds into its neighbour
_REPEAT, _MIRRORED, _CLAMP = 10497, 33648, 33071


@dataclass(frozen=True, eq=False, kw_only=True)
class Paint:
    """The base colour of a material.

    Args:
        picture: (H, W, 3) uint8 RGB; None for a plain colour.
        colour: (3,) uint8, where there is no picture.
        wrap: how the picture goes on beyond its borders, in u and v, as glTF numbers it.
        uv_set: which texture coordinates it takes.
        transform: (2, 3) that these go through first; None for none.
    """

    picture: Bytes | None
    colour: tuple[int, int, int] = CLAY
    wrap: tuple[int, int] = (_CLAMP, _CLAMP)
    uv_set: int = 0
    transform: Doubles | None = None


def read_paint(file: GlbFile, material: Any) -> Paint:
    """The base colour of a material, by its index; None is clay.

    Source: Khronos, glTF 2.0 specification, sections 3.8 and 3.9; KHR_texture_transform; EXT_texture_webp.

    Raises:
        InputError: it is not in the file, or its picture cannot be decoded.
    """
    if material is None:
        return Paint(picture=None)
    surface = as_object(file.entry("materials", material).get("pbrMetallicRoughness", {}))
    factor = np.array(surface.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)), np.float64).clip(0, 1)
    if factor.shape != (4,) or not np.isfinite(factor).all():
        raise file.damaged("a colour has not four parts")
    used = surface.get("baseColorTexture")
    if used is None:
        red, green, blue = (int(part) for part in _from_linear(factor[:3]))
        return Paint(picture=None, colour=(red, green, blue) if "baseColorFactor" in surface else CLAY)
    texture = file.entry("textures", used["index"])
    webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
    image = file.entry("images", webp.get("source", texture.get("source")))
    data = file.view(image["bufferView"]) if "bufferView" in image else file.embedded(image.get("uri"))
    picture = decode_image(data, f"the texture in {file.name}")
    eight = picture if picture.dtype == np.uint8 else (picture >> 8).astype(np.uint8)
    colours = eight if eight.ndim == 3 else np.repeat(eight[..., None], 3, axis=2)
    if (factor[:3] != 1).any():
        levels = _to_linear(np.arange(256) / 255.0)
        colours = np.stack([_from_linear(levels * part)[colours[..., c]] for c, part in enumerate(factor[:3])], axis=2)
    sampler = file.entry("samplers", texture["sampler"]) if "sampler" in texture else {}
    moved = used.get("extensions", {}).get("KHR_texture_transform")
    return Paint(
        picture=np.ascontiguousarray(colours),
        wrap=(sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)),
        uv_set=(moved or used).get("texCoord", used.get("texCoord", 0)),
        transform=None if moved is None else _uv_transform(moved),
    )


def lay_out(parts: Sequence[tuple[Paint, Floats]], file: GlbFile) -> tuple[Bytes, Floats]:
    """One texture for all parts, and all their uv on it, one after another.

    A single picture that does not repeat stays as it is, and so do its uv.

    Raises:
        InputError: a picture repeats too often, all together are too large, or coordinates are not finite.
    """
    uvs = [_moved(paint, uv) for paint, uv in parts]
    if not all(np.isfinite(uv).all() for uv in uvs):
        raise file.damaged("a texture coordinate is not finite")
    if len({id(paint) for paint, _ in parts}) == 1:
        paint = parts[0][0]
        whole = np.concatenate(uvs)
        if paint.picture is None:
            return np.full((1, 1, 3), paint.colour, np.uint8), whole
        if paint.wrap == (_CLAMP, _CLAMP) or (whole.min() >= 0 and whole.max() <= 1):
            return paint.picture, whole
    tiles: dict[tuple[int, int, int, int, int], Bytes] = {}
    keys, shifted = [], []
    for (paint, _), uv in zip(parts, uvs, strict=True):
        low, high = _tiles(paint, uv)
        key = (id(paint), *low, *high)
        if key not in tiles:
            tiles[key] = _repeated(paint, low, high, file.name)
        keys.append(key)
        shifted.append((uv - np.array(low)) / (np.array(high) - low))
    sheet, boxes = _pack(list(tiles.values()), file.name)
    where = dict(zip(tiles, boxes, strict=True))
    scale = np.array(sheet.shape[1::-1], np.float64)
    placed = [
        (np.array(where[key][:2]) + np.clip(uv, 0, 1) * np.array(where[key][2:])) / scale
        for key, uv in zip(keys, shifted, strict=True)
    ]
    return sheet, np.concatenate(placed).astype(np.float32)


def _moved(paint: Paint, uv: Floats) -> Floats:
    if paint.transform is None:
        return uv
    return np.asarray(uv @ paint.transform[:, :2].T + paint.transform[:, 2], np.float32)


def _uv_transform(moved: dict[str, Any]) -> Doubles:
    angle = float(moved.get("rotation", 0.0))
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, sin], [-sin, cos]]) * np.array(moved.get("scale", (1, 1)), np.float64)
    return np.column_stack([turn, np.array(moved.get("offset", (0, 0)), np.float64)])


def _tiles(paint: Paint, uv: Floats) -> tuple[tuple[int, int], tuple[int, int]]:
    """The first and past the last copy of the picture that a part reaches into, in u and v."""
    slack = 1e-3  # rounding must not ask for another copy
    low, high = [0, 0], [1, 1]
    for axis in range(2):
        if paint.picture is not None and paint.wrap[axis] != _CLAMP:
            low[axis] = int(np.floor(uv[:, axis].min() + slack))
            high[axis] = max(low[axis] + 1, int(np.ceil(uv[:, axis].max() - slack)))
    return (low[0], low[1]), (high[0], high[1])


def _repeated(paint: Paint, low: tuple[int, int], high: tuple[int, int], name: str) -> Bytes:
    if paint.picture is None:
        return np.full((1, 1, 3), paint.colour, np.uint8)
    picture = paint.picture
    for axis, along in ((0, 1), (1, 0)):  # u runs along the columns
        copies = high[axis] - low[axis]
        if copies * picture.shape[along] > SIDE_LIMIT:
            raise InputError(f"{name} repeats a texture {copies} times: bake it to one picture without repeats")
        other = np.flip(picture, along) if paint.wrap[axis] == _MIRRORED else picture
        picture = np.concatenate(
            [other if number % 2 else picture for number in range(low[axis], high[axis])], axis=along
        )
    return picture


def _pack(pictures: Sequence[Bytes], name: str) -> tuple[Bytes, list[tuple[int, int, int, int]]]:
    """Pictures on shelves, the highest first; the sheet, and x, y, width and height of each."""
    sizes = [(picture.shape[1] + 2 * _GUTTER, picture.shape[0] + 2 * _GUTTER) for picture in pictures]
    width = max(max(wide for wide, _ in sizes), int(np.ceil(np.sqrt(sum(wide * high for wide, high in sizes)))))
    boxes = [(0, 0, 0, 0)] * len(pictures)
    x = y = shelf = 0
    for index in sorted(range(len(pictures)), key=lambda index: -sizes[index][1]):
        wide, high = sizes[index]
        if x + wide > width:
            x, y, shelf = 0, y + shelf, 0
        boxes[index] = (x + _GUTTER, y + _GUTTER, wide - 2 * _GUTTER, high - 2 * _GUTTER)
        x, shelf = x + wide, max(shelf, high)
    if max(width, y + shelf) > SIDE_LIMIT:
        raise InputError(f"{name} has {len(pictures)} textures, together over {SIDE_LIMIT} px a side: scale them down")
    sheet = np.zeros((y + shelf, width, 3), np.uint8)
    for picture, (x, y, wide, high) in zip(pictures, boxes, strict=True):
        framed = cv2.copyMakeBorder(picture, *(_GUTTER,) * 4, cv2.BORDER_REPLICATE)
        sheet[y - _GUTTER : y + high + _GUTTER, x - _GUTTER : x + wide + _GUTTER] = framed
    return sheet, boxes


def _to_linear(levels: Doubles) -> Doubles:
    """IEC 61966-2-1."""
    return np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)


def _from_linear(light: Doubles) -> Bytes:
    levels = np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    return np.asarray(np.clip(levels * 255 + 0.5, 0, 255), np.uint8)
