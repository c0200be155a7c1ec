"""YAML as a tree of text: from the parser's events, so that no tag, alias or depth can do harm."""

from __future__ import annotations

import re

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.tree import DEEPEST, Tree, insert


def parse_yaml(data: bytes) -> Tree:
    """The first document of a YAML file; OpenCV's `%YAML:1.0`, which is no YAML, is taken too.

    Raises:
        InputError: this is no YAML, is cut off, is too deep, or has aliases or a name twice.
    """
    import yaml

    # libyaml's parser takes a second where PyYAML's own takes a minute; some builds of PyYAML come without it.
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    data = re.sub(rb"\A(\xef\xbb\xbf)?%YAML[^\r\n]*", b"", data)
    builder = _Builder()
    try:
        for event in yaml.parse(data, Loader=loader):
            if isinstance(event, yaml.AliasEvent):
                raise InputError(f"it has the alias *{event.anchor:.40}: write the value itself")
            if isinstance(event, (yaml.MappingStartEvent, yaml.SequenceStartEvent)):
                builder.open({} if isinstance(event, yaml.MappingStartEvent) else [])
            elif isinstance(event, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
                builder.close()
            elif isinstance(event, yaml.ScalarEvent):
                builder.add(event.value)
            elif isinstance(event, yaml.DocumentEndEvent):
                break
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f" at line {mark.line + 1}" if mark is not None else ""
        told = " ".join(str(getattr(error, "problem", None) or getattr(error, "reason", None) or "not text").split())
        raise InputError(f"no calibration, or cut off: as YAML {told:.80}{place}; copy it again") from None
    if builder.tree is None:
        raise InputError("it has no content: copy it again")
    return builder.tree


class _Builder:
    """Puts the pieces that a parser finds into a tree, without recursion."""

    def __init__(self) -> None:
        self.tree: Tree | None = None
        self._open: list[dict[str, Tree] | list[Tree]] = []
        self._names: list[str | None] = []  # of each open mapping: the name whose value comes next

    def open(self, part: dict[str, Tree] | list[Tree]) -> None:
        """Begin a mapping or a list."""
        if len(self._open) == DEEPEST:
            raise InputError(f"it is nested more than {DEEPEST} deep: is this a calibration file?")
        self.add(part)
        self._open.append(part)
        self._names.append(None)

    def close(self) -> None:
        """End the innermost mapping or list."""
        self._open.pop()
        self._names.pop()

    def add(self, value: Tree) -> None:
        """Put a value where it belongs."""
        if not self._open:
            self.tree = value
            return
        inner = self._open[-1]
        if isinstance(inner, list):
            inner.append(value)
        elif self._names[-1] is not None:
            insert(inner, self._names[-1], value)
            self._names[-1] = None
        elif isinstance(value, str):
            self._names[-1] = value
        else:
            raise InputError("it has a list or a mapping as a name: is this a calibration file?")
