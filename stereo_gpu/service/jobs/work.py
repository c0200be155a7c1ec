"""What a worker does: it warms up once, and then does a job after another, each in its own folder."""

from __future__ import annotations

import os
import platform
import shutil
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereo_gpu.backends import open_backend
from stereo_gpu.engines.executor import Tell
from stereo_gpu.errors import BackendError, MemoryLimitError, StereoError, WorkerError
from stereo_gpu.pipeline import reconstruct
from stereo_gpu.scene import build_scene
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.jobs.calibrate_job import calibrate_job
from stereo_gpu.service.jobs.order import WorkOrder
from stereo_gpu.service.jobs.reconstruct_job import reconstruct_job
from stereo_gpu.service.records import Kind
from stereo_gpu.service.refusals import StoreError

WARM_SIZE = 160, 120  # px: the kernels that jobs need all run, and it takes a second
WARM_SHIFT = 12  # px between the views of the plane that is seen
WARM_PROFILES = "fast", "precise"  # what "paper" has for itself takes a tenth of a second


def prepare(*, data: Path, backend: str | None) -> None:
    """Compile and run the kernels once, and start what unwraps, so that the first job need not wait for that.

    Raises:
        StereoError: the device is missing or fails, or this machine does not see the service's folder.
    """
    if not data.is_dir():
        raise WorkerError(f"there is no folder {data} on {platform.node()}: put it on storage that all nodes share")
    width, height = WARM_SIZE
    noise = np.random.default_rng(0).integers(0, 256, (height, width + WARM_SHIFT), np.uint8)
    plane = np.asarray(cv2.GaussianBlur(noise, (0, 0), 1.5), np.uint8)
    left, right = plane[:, :-WARM_SHIFT], plane[:, WARM_SHIFT:]
    for profile in WARM_PROFILES:
        reconstruct(left, right, build_scene(WARM_SIZE).rig, profile=profile, backend=backend, check="never")


def do_job(order: WorkOrder, *, data: Path, backend: str | None, tell: Tell) -> dict[str, Any]:
    """Do one try of a job: what came out lies sealed in its attempt's folder then.

    Args:
        order: the job.
        data: the service's folder, as this machine sees it.
        backend: where to compute; None for the best device.
        tell: told each stage as it begins, and `step:NAME` when a picture of a step is there.

    Returns:
        "outcome", an `Outcome`; and "device", the name of a GPU and the bytes that it has left, or None.

    Raises:
        StereoError: one line, as on the command line.
        WorkerError: the folder cannot be written, which is not the job's fault.
    """
    folders = Folders(data)
    attempt = folders.attempt(order.job, order.number)
    shutil.rmtree(attempt, ignore_errors=True)
    try:
        if order.kind is Kind.CALIBRATION:
            outcome = calibrate_job(order, folders, tell)
        else:
            outcome = reconstruct_job(order, folders, backend, tell)
        folders.seal(attempt)
    except OSError as error:
        _leave_if_gone(data)
        raise WorkerError(f"its folder cannot be written: {error.strerror or error}") from error
    except StereoError as error:
        _leave_if_gone(data)
        if isinstance(error, BackendError) and not isinstance(error, MemoryLimitError):
            _leave_if_unfit(data, backend)
        told = _told(error, folders, order)
        # What `files.write_whole` and its like make of a full disk is no fault of the job.
        if isinstance(error, StoreError) or isinstance(error.__cause__, OSError):
            raise WorkerError(told) from error
        raise type(error)(told) from error
    return {"outcome": outcome, "device": _device(backend)}


def _leave_if_gone(data: Path) -> None:
    """End this worker if storage that it shares is gone: it would lose every job that comes, as fast as it could."""
    if not os.path.isdir(data):  # noqa: PTH112  # which does not raise where a mount is stale
        sys.exit(f"stereo-gpu: this worker ends, {data} is there no more")


def _leave_if_unfit(data: Path, backend: str | None) -> None:
    """End this worker if its device does nothing more, as after a fault on a GPU: a new process has a new context."""
    try:
        prepare(data=data, backend=backend)
    except StereoError as error:
        sys.exit(f"stereo-gpu: this worker ends, its device does not work any more: {error}")


def _told(error: StereoError, folders: Folders, order: WorkOrder) -> str:
    """The line, with names of files as the client knows them: where the service keeps them is none of its business."""
    text = str(error)
    for folder in (folders.inputs(order.job), folders.attempt(order.job, order.number), folders.root):
        text = text.replace(f"{folder}/", "").replace(str(folder), "the service's folder")
    return text


def _device(name: str | None) -> tuple[str, int] | None:
    backend = open_backend(name)
    return (backend.name, backend.available_bytes()[0]) if backend.kind == "gpu" else None
