"""XML as a tree of text; without a document type, so that nothing can be defined, expanded or fetched."""

from __future__ import annotations

from xml.parsers import expat

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.tree import DEEPEST, Tree, insert

ITEM = "_"  # what OpenCV calls the items of a sequence


def parse_xml(data: bytes) -> Tree:
    """The root element: names are element names, items called `_` make a list, all else is text.

    Raises:
        InputError: this is no XML, is cut off, is too deep, defines a document type, or has a name twice.
    """
    builder = _Builder()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = _refuse_doctype
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.text
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        told = expat.ErrorString(error.code)
        raise InputError(f"not XML, or cut off: {told} at line {error.lineno}; copy it again") from None
    except (LookupError, ValueError, UnicodeError) as error:  # an encoding that Python does not know, or not as expat
        raise InputError(f"it cannot be read as text ({type(error).__name__}): save it as UTF-8") from None
    return builder.root


def _refuse_doctype(name: str, *_: object) -> None:
    raise InputError(
        f"it defines a document type, {name!r:.40}, which no calibration needs: delete the <!DOCTYPE> part"
    )


class _Element:
    """An element that is being read."""

    def __init__(self) -> None:
        self.named: dict[str, Tree] = {}
        self.items: list[Tree] = []
        self.text: list[str] = []

    def tree(self) -> Tree:
        """What it comes to, once all of it was read."""
        if self.items and self.named:
            raise InputError(f"an element holds items and {next(iter(self.named)):.40}: is this a calibration file?")
        return self.named or self.items or "".join(self.text).strip().strip('"')


class _Builder:
    """Puts the pieces that expat finds into a tree, without recursion."""

    def __init__(self) -> None:
        self.root: Tree = ""
        self._open: list[_Element] = []

    def start(self, _name: str, _attributes: dict[str, str]) -> None:
        """Begin an element."""
        if len(self._open) == DEEPEST:
            raise InputError(f"it is nested more than {DEEPEST} deep: is this a calibration file?")
        self._open.append(_Element())

    def text(self, piece: str) -> None:
        """Keep text of the innermost element."""
        self._open[-1].text.append(piece)

    def end(self, name: str) -> None:
        """End the innermost element."""
        tree = self._open.pop().tree()
        if not self._open:
            self.root = tree
        elif name == ITEM:
            self._open[-1].items.append(tree)
        else:
            insert(self._open[-1].named, name, tree)
