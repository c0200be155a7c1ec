"""Options as JSON: each is checked as on the command line before a job is taken."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from stereo_gpu.config import MeshOptions, Profile
from stereo_gpu.errors import InputError
from stereo_gpu.job import MOST_SMOOTHING, plan_job
from stereo_gpu.match_options import check_range
from stereo_gpu.model_files.texture_file import TEXTURE_FORMATS, check_texture_format
from stereo_gpu.service.records import InputFile
from stereo_gpu.types import View

OPTIONS_BYTES = 16 << 10  # of the JSON; all options together take some hundred
SHOWN = 60  # characters of a wrong value
LARGEST = 2**31 - 1  # what kernels count with

# What cannot be said of one number alone.
WANTED = {
    "disparities": 'give "auto" or [smallest, how many], px',
    "window": 'give the side of a square in px, odd, 3 to 31, "auto", or null for the profile\'s',
    "rectangle": "give [x, y, width, height], px",
    "depth": "give [nearest, farthest], null for an end that is open",
}

Word = Annotated[str, Field(max_length=40)]
Whole = Annotated[int, Field(ge=-LARGEST, le=LARGEST)]


def _told(default: Any, **schema: Any) -> Any:
    """A field of which the OpenAPI document says more than is checked here: what checks it has a better line."""
    return Field(default, json_schema_extra=schema)


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class MeshJson(_Strict):
    """How the mesh is made; `MeshOptions` says what each one means."""

    method: Word = _told("bounded", enum=["bounded", "dense"])
    error_px: float = _told(0.25, exclusiveMinimum=0)
    max_jump_px: float = _told(3.0, exclusiveMinimum=0)
    largest_hole: Whole | None = 400
    smallest_part: Whole = _told(150, minimum=0)
    faces: Whole = _told(50_000, minimum=0)
    decimate_error: float | None = None
    smoothing: Whole = _told(10, minimum=0, maximum=MOST_SMOOTHING)
    unwrap: Word = _told("charts", enum=["charts", "view"])


class JobOptions(_Strict):
    """The options of a reconstruction; `reconstruct` and `Reconstruction.save` say what each one means.

    Args:
        check: "first" checks the rig in full until a pair of it was right, and by rows from then on.
        depth: nearest and farthest; null for an end that is open.
        files: "model" for model.glb and result.json, "all" for the report and the other formats besides.
        steps: whether pictures of the steps are wanted while it runs.
    """

    profile: Word = _told("precise", enum=list(Profile))
    disparities: Literal["auto"] | tuple[Whole, Whole] = "auto"
    window: Whole | Literal["auto"] | None = None
    reference: Word = _told("right", enum=list(View))
    rectangle: tuple[Whole, Whole, Whole, Whole] | None = None
    depth: tuple[float | None, float | None] | None = None
    tile: Whole | None = None
    ignore_check: bool = False
    check: Literal["first", "full", "rows", "never"] = "first"
    mesh: MeshJson = MeshJson()
    files: Literal["model", "all"] = "model"
    texture_format: Word = _told("png", enum=list(TEXTURE_FORMATS))
    steps: bool = False

    @model_validator(mode="after")
    def _as_on_the_command_line(self) -> Self:
        check_texture_format(self.texture_format, None)
        keywords = self.keywords()
        del keywords["ignore_check"]
        plan_job(**keywords, mask=None)
        return self

    def keywords(self) -> dict[str, Any]:
        """Arguments of `reconstruct`; mask, check, backend and progress are the caller's to add."""
        depth = None
        if self.depth is not None:
            near, far = self.depth
            depth = (near or 0.0, math.inf if far is None else far)
        return {
            "profile": self.profile,
            "disparities": self.disparities,
            "window": self.window,
            "reference": self.reference,
            "rectangle": self.rectangle,
            "depth": depth,
            "tile": self.tile,
            "ignore_check": self.ignore_check,
            "mesh": MeshOptions(**self.mesh.model_dump()),
        }

    def given(self) -> dict[str, Any]:
        """Those that the client gave, as JSON; for the table, from which `read_options` makes them again."""
        return self.model_dump(mode="json", exclude_unset=True)


def read_options(given: str | bytes | Mapping[str, Any], *, width: int | None = None) -> JobOptions:
    """Parse the options of a job.

    Args:
        given: JSON, or what `JobOptions.given` gave.
        width: of the pictures, px; the range of disparities must lie within them.

    Raises:
        InputError: this is no JSON object, an option is unknown, or its value wrong.
    """
    try:
        if isinstance(given, Mapping):
            # Not in Python's way, in which a list is no tuple.
            given = json.dumps(dict(given), allow_nan=False)
        options = JobOptions.model_validate_json(given or "{}")
    except ValidationError as error:
        raise InputError(_line(error.errors(include_url=False)[0])) from None
    if width is not None and options.disparities != "auto":
        check_range(options.disparities, width)
    return options


def fingerprint(fields: Mapping[str, Any], inputs: Sequence[InputFile]) -> str:
    """What makes two requests the same one, for an Idempotency-Key: all fields, and the bytes of all files.

    Args:
        fields: kind, rig, label, options and so on, as JSON could hold them.
        inputs: the files.
    """
    told = {"fields": fields, "inputs": [(file.name, file.sha256) for file in inputs]}
    return hashlib.sha256(json.dumps(told, sort_keys=True, default=str).encode()).hexdigest()


def _line(error: ErrorDetails) -> str:
    """One line that names the option, its value and what it should be."""
    if error["type"] == "json_invalid":
        return f'options are no JSON: {error["ctx"]["error"]}; send an object such as {{"profile": "fast"}}'
    name = ".".join(map(str, error["loc"])) or "options"
    if error["type"] == "extra_forbidden":
        return f"option {name!r:.60} is unknown: give any of {', '.join(_known(error))}"
    wanted = error["msg"][:1].lower() + error["msg"][1:]
    if error["loc"] and error["loc"][0] in WANTED:
        # The rest of the place is a part of it, or the way of reading it that was tried last.
        name = str(error["loc"][0])
        wanted = WANTED[name]
    return f"{name} = {_shown(error.get('input'))}: {wanted}"


def _known(error: ErrorDetails) -> list[str]:
    return list(MeshJson.model_fields if error["loc"][0] == "mesh" else JobOptions.model_fields)


def _shown(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
