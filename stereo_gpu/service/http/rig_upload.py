"""From the files of a rig, of any supported program, to a rig of the service."""

from __future__ import annotations

import re
import secrets
import time
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.rig import Rig
from stereo_gpu.rig_files.load import load_rig
from stereo_gpu.service.http.accepting import BYTES_EACH, LONGEST_LABEL, read_title
from stereo_gpu.service.intake.multipart import FileWanted, FormSpec
from stereo_gpu.service.intake.uploads import Form
from stereo_gpu.service.jobs.rig_summary import summarise
from stereo_gpu.service.problems import Problem
from stereo_gpu.service.records import InputFile, RigRecord
from stereo_gpu.service.service import Service

LARGEST_FILE = 2 << 20  # bytes: they are read here, not by a worker; a rig of ten thousand views has 3 MB
RIG_FORM = FormSpec(
    files={"file": FileWanted(most=2, picture=False)},
    fields={"name": BYTES_EACH * LONGEST_LABEL, "size": 40, "unit": 8},
)
# Which of two files comes second, where they are not sent in order.
_SECOND = re.compile(r"right|extrinsic", re.IGNORECASE)


def accept_rig(service: Service, client: str, form: Form) -> RigRecord:
    """Read the files, and keep the rig as one of ours.

    Raises:
        InputError: they are of no known format, cut off, damaged, or say what no rig can be.
        Problem: they are too large.
    """
    with form:
        files = sorted(form.files["file"], key=lambda file: bool(_SECOND.search(file.given)))
        for file in files:
            if file.size > LARGEST_FILE:
                raise Problem(
                    413, f"{file.given or 'file'} has {file.size} bytes, the limit of a rig is {LARGEST_FILE}"
                )
        unit = form.fields.get("unit") or None
        rig = _read([form.path(file) for file in files], files, _size(form.fields.get("size", "")), unit)
        id = secrets.token_hex(16)
        service.folders.keep_rig(id, rig.save)
        name = read_title("name", form.fields.get("name", "")) or files[0].given or "rig"
        record = RigRecord(id=id, client=client, name=name, created=time.time(), summary=summarise(rig))
        service.metrics.received(form.bytes)
        return service.store.add_rig(record)


def _read(paths: list[Path], files: list[InputFile], size: tuple[int, int] | None, unit: str | None) -> Rig:
    try:
        return load_rig(*paths, size=size, unit=unit)
    except InputError as error:
        # The client's names in place of ours.
        text = str(error)
        for path, file in zip(paths, files, strict=True):
            text = text.replace(str(path), file.given or "file").replace(path.name, file.given or "file")
        raise InputError(text) from None


def _size(text: str) -> tuple[int, int] | None:
    parts = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text, re.ASCII)
    if parts is None and text:
        raise InputError(f"size = {text!r:.60}: give width x height of the pictures, px, such as 640x480")
    return (int(parts[1]), int(parts[2])) if parts else None
