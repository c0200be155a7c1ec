"""One call of a task, whatever comes of it."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from stereo_gpu.errors import StageError, StereoError

Raised = TypeVar("Raised", bound=BaseException)


def call(task: Callable[..., Any], job: tuple[Any, ...], arguments: Mapping[str, Any]) -> tuple[bool, Any]:
    """Do a job here: (True, what the task returned) or (False, the `StereoError` that says why it failed)."""
    try:
        return True, task(*job, **arguments)
    except StereoError as error:
        return False, _let_go(error)
    except Exception as error:
        return False, failure(_let_go(error))


def failure(error: Exception) -> StageError:
    """What is told of an error that was not raised on purpose; its traceback goes along as a note."""
    told = StageError(f"{in_one_line(error)} (this is a fault of ours: try the pair by itself)")
    told.add_note("".join(traceback.format_exception(error)))
    return told


def in_one_line(error: BaseException) -> str:
    """Its kind and what it says."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def _let_go(error: Raised) -> Raised:
    """The error without the arrays of the frames that it came through, which would live as long as it does."""
    cause: BaseException | None = error
    while cause is not None:
        traceback.clear_frames(cause.__traceback__)
        cause = cause.__cause__ or cause.__context__
    return error
