"""Files of one named value a line, `name=value` or `name: value`, as Middlebury's and KITTI's are."""

from __future__ import annotations

import re

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.tree import Tree, insert


def parse_lines(data: bytes) -> dict[str, Tree]:
    """Names and the text behind them; empty lines and comments (#) are passed over.

    Raises:
        InputError: this is no text, a line has no name, or a name stands twice.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("it is not text: is this a calibration file?") from None
    found: dict[str, Tree] = {}
    for count, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = re.match(r"\s*(\w+)\s*[:=]\s*(.*)", line, re.ASCII)
        if match is None:
            raise InputError(f"line {count} reads {line!r:.40}: it must be a name, = or :, and a value")
        insert(found, match[1], match[2].strip())
    return found
