"""From a form that was received to a job in the queue: its pictures take their place first, then comes the row."""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping, Sequence
from typing import Any

from stereo_gpu.boards.choose import choose_board
from stereo_gpu.errors import InputError, PictureError, StereoError
from stereo_gpu.images import check_one_size
from stereo_gpu.mask import check_mask_size
from stereo_gpu.rectify import check_size
from stereo_gpu.service.intake.multipart import FileWanted, FormSpec
from stereo_gpu.service.intake.uploads import Form
from stereo_gpu.service.options import OPTIONS_BYTES, fingerprint, read_options
from stereo_gpu.service.records import InputFile, Job, Kind, RigRecord
from stereo_gpu.service.refusals import StoreError, no_rig
from stereo_gpu.service.service import Service

MOST_BOARDS = 400  # pictures of each camera; fifty are many
LONGEST_LABEL = 200  # characters
BYTES_EACH = 4  # of a character in UTF-8, at most
LONGEST_WORD = 40
KEY = r"^[\x21-\x7e]{1,200}$"

PAIR_FORM = FormSpec(
    files={"left": FileWanted(), "right": FileWanted(), "mask": FileWanted(least=0)},
    fields={"rig": 64, "options": OPTIONS_BYTES, "label": BYTES_EACH * LONGEST_LABEL},
    required=("rig",),
)
BOARDS_FORM = FormSpec(
    files={"left": FileWanted(most=MOST_BOARDS), "right": FileWanted(most=MOST_BOARDS)},
    fields={
        "board": LONGEST_WORD,
        "square": LONGEST_WORD,
        "marker": LONGEST_WORD,
        "dictionary": LONGEST_WORD,
        "label": BYTES_EACH * LONGEST_LABEL,
    },
    required=("board", "square"),
)


def accept_pair(service: Service, client: str, form: Form, key: str | None) -> tuple[Job, bool]:
    """Take a pair; gives the job, and whether it is new.

    Raises:
        InputError: a picture, the rig or an option is wrong, or the key was used for something else.
        QueueFull: too many jobs wait.
    """
    with form:
        (left,), (right,) = form.files["left"], form.files["right"]
        check_one_size(left.picture_size, right.picture_size)
        rig = named_rig(service, client, form)
        check_size(left.picture_size, rig.picture_size)
        for mask in form.files["mask"]:
            check_mask_size("mask", mask.picture_size, rig.picture_size)
        options = read_options(form.fields.get("options", ""), width=left.width).given()
        return _enqueue(service, client, form, Kind.RECONSTRUCTION, options, rig.id, key)


def accept_boards(service: Service, client: str, form: Form, key: str | None) -> tuple[Job, bool]:
    """Take pictures of a board; gives the job, and whether it is new.

    Raises:
        InputError: the pictures or the board are wrong, or the key was used for something else.
        QueueFull: too many jobs wait.
    """
    with form:
        left, right = form.files["left"], form.files["right"]
        if len(left) != len(right):
            raise InputError(f"left has {len(left)} pictures, right has {len(right)}: give both pictures of every pair")
        for side, some in form.files.items():
            _check_camera(side, some)
        options = _board_options(form.fields)
        return _enqueue(service, client, form, Kind.CALIBRATION, options, None, key)


def named_rig(service: Service, client: str, form: Form) -> RigRecord:
    """The rig that a form names.

    Raises:
        InputError: the client has none of this id.
    """
    id = form.fields["rig"]
    rig = service.store.rig(client, id)
    if rig is None:
        raise no_rig(id)
    return rig


def read_title(name: str, given: str) -> str:
    """What a client calls a thing, on one line of what can be shown.

    Raises:
        InputError: it is too long.
    """
    if len(given) > LONGEST_LABEL:
        raise InputError(f"{name} has {len(given)} characters, the limit is {LONGEST_LABEL}: shorten it")
    return " ".join("".join(letter if letter.isprintable() else " " for letter in given).split())


def _check_camera(side: str, pictures: Sequence[InputFile]) -> None:
    """Refuse pictures of one camera that differ in size."""
    first = pictures[0]
    for picture in pictures:
        if picture.picture_size != first.picture_size:
            raise PictureError(
                f"{side}: {picture.given or picture.name} is {picture.width} x {picture.height} px,"
                f" {first.given or first.name} is {first.width} x {first.height} px:"
                " give pictures of one camera, all of one size"
            )


def _board_options(fields: Mapping[str, str]) -> dict[str, Any]:
    """The board, as the job's options keep it: board, square, marker and dictionary."""
    square, marker = (_length(name, fields[name]) if fields.get(name) else None for name in ("square", "marker"))
    dictionary = fields.get("dictionary") or None
    choose_board(fields["board"], square, marker, dictionary)
    options = {"board": fields["board"].strip(), "square": square, "marker": marker, "dictionary": dictionary}
    return {name: value for name, value in options.items() if value is not None}


def _length(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name} = {text!r:.60}: give a length in mm") from None


def _enqueue(
    service: Service, client: str, form: Form, kind: Kind, options: dict[str, Any], rig: str | None, key: str | None
) -> tuple[Job, bool]:
    first = form.inputs[0]
    label = read_title("label", form.fields.get("label", ""))
    job = Job(
        id=secrets.token_hex(16),
        client=client,
        kind=kind,
        created=time.time(),
        rig=rig,
        label=label,
        options=options,
        inputs=form.inputs,
        pixels=first.width * first.height,
        bytes=form.bytes,
    )
    told = fingerprint({"kind": kind, "rig": rig, "label": label, "options": options}, form.inputs)
    limits = {"queue_limit": service.settings.queue_limit, "client_limit": service.settings.client_limit}
    service.folders.accept(form.folder, job.id)
    form.keep()
    try:
        taken, new = service.store.enqueue(job, key=key, fingerprint=told, **limits)
    except StoreError:
        raise  # whether the row is there nobody knows now; a folder without one is swept later
    except StereoError:
        service.folders.remove_job(job.id)
        raise
    if new:
        service.metrics.accepted(kind)
        service.metrics.received(job.bytes)
        service.dispatcher.wake()
    else:
        service.folders.remove_job(job.id)
    return taken, new
