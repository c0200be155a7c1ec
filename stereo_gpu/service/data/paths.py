"""Where the service keeps its files: every path is made here, from ids of 32 hexadecimal digits and nothing else.

DATA/service.sqlite3        the table
DATA/token, DATA/lock       the first token; held while a service runs
DATA/rigs/ID/rig.json
DATA/jobs/ID/inputs/        as they were sent
DATA/jobs/ID/try-N.part/    what a try has made so far
DATA/jobs/ID/result/        of the try that ended well; manifest.json says what is in it
DATA/jobs/ID/steps/         pictures of steps
DATA/outlines/ID/           views to paint on
DATA/uploads/X.part/        what is being sent, and what is being removed
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from stereo_gpu.service.refusals import NotFound

ID = re.compile(r"[0-9a-f]{32}")
TRY = re.compile(r"try-[0-9]+\.part")
UPLOAD = re.compile(r"[0-9a-f]{32}\.part")
_STEP = re.compile(r"[a-z0-9][a-z0-9-]{0,39}")


class Paths:
    """The paths of a service's data folder; nothing is read or written."""

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = Path(root).absolute()
        self.database = self.root / "service.sqlite3"
        self.token_file = self.root / "token"
        self.lock = self.root / "lock"
        self.jobs = self.root / "jobs"
        self.rigs = self.root / "rigs"
        self.outlines = self.root / "outlines"
        self.uploads = self.root / "uploads"

    def job(self, id: str) -> Path:
        """The folder of a job.

        Raises:
            NotFound: the id is none; so do all that take one.
        """
        return self.jobs / _checked(id)

    def inputs(self, id: str) -> Path:
        """The folder of the pictures that a job was sent with."""
        return self.job(id) / "inputs"

    def attempt(self, id: str, number: int) -> Path:
        """The folder that the try of this number writes."""
        return self.job(id) / f"try-{int(number)}.part"

    def result(self, id: str) -> Path:
        """The folder of a job's result."""
        return self.job(id) / "result"

    def steps(self, id: str) -> Path:
        """The folder of the pictures of a job's steps."""
        return self.job(id) / "steps"

    def step(self, id: str, name: str) -> Path:
        """The picture of a step.

        Raises:
            NotFound: `name` is no name of a step.
        """
        if not _STEP.fullmatch(name):
            raise NotFound(f"there is no step {name[:60]!r}: ask for the job")
        return self.steps(id) / f"{name}.jpg"

    def rig(self, id: str) -> Path:
        """The file of a rig, in a folder of its own."""
        return self.rigs / _checked(id) / "rig.json"

    def outline(self, id: str) -> Path:
        """The folder of a view to paint on."""
        return self.outlines / _checked(id)


def _checked(id: str) -> str:
    if not ID.fullmatch(id):
        raise NotFound(f"{id[:40]!r} is no id: ids are 32 hexadecimal digits")
    return id
