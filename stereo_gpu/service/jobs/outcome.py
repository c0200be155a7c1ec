"""What a worker tells the table of a job that went well; the result holds it, too, should the service die between."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from stereo_gpu.service.records import Kind

_KEY = "service"
_RECORDS = {Kind.RECONSTRUCTION: "result.json", Kind.CALIBRATION: "calibration.json"}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came out, in plain values.

    Args:
        summary: what a list of jobs shows.
        warnings: what a person should know.
        seconds: of each stage.
        checked: whether the rig was checked in full, and is good.
        rig: of a calibration: the summary of its rig, as `RigRecord` has it.
    """

    summary: dict[str, Any]
    warnings: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    checked: bool = False
    rig: dict[str, Any] | None = None

    def as_json(self) -> dict[str, Any]:
        """What result.json or calibration.json holds besides."""
        told = {"summary": self.summary, "warnings": list(self.warnings), "seconds": self.seconds}
        return {_KEY: {**told, "checked": self.checked, "rig": self.rig}}

    @classmethod
    def read(cls, folder: Path, kind: Kind) -> Self | None:
        """What lies in a result; None where it tells nothing."""
        try:
            told = json.loads((folder / _RECORDS[kind]).read_text("utf-8"))[_KEY]
            return cls(**{**told, "warnings": tuple(told["warnings"])})
        except (OSError, ValueError, KeyError, TypeError):
            return None
