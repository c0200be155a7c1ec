"""Many pairs of one rig, each on a core of its own: decode, match, mesh, unwrap, bake and encode of them overlap."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from stereo_gpu.backends import Backend, open_backend
from stereo_gpu.backends.share import usable_cores
from stereo_gpu.config import MeshOptions
from stereo_gpu.engines.executor import Answer, Limits, Work
from stereo_gpu.engines.in_order import run_in_order
from stereo_gpu.engines.local import LocalExecutor
from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.inputs import Source
from stereo_gpu.job import Rectangle, plan_job
from stereo_gpu.match_options import Range, Window
from stereo_gpu.pipeline import reconstruct
from stereo_gpu.rig import Rig
from stereo_gpu.types import Bytes

CHECKS = ("first", "every", "never")
MOST_ON_A_GPU = 8  # workers: each has a context of its own there, of some hundred MB
Then = Callable[[int, Any], Any]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a pair.

    Args:
        index: of the pair, from 0, in the order given.
        result: the `Reconstruction`, or what `then` made of it; None where it failed.
        error: why it failed; None where it did not.
        seconds: that the pair took in its process.
    """

    index: int
    result: Any
    error: StereoError | None
    seconds: float


def reconstruct_many(
    pairs: Iterable[tuple[Source, Source] | tuple[Source, Source, Bytes | None]],
    rig: Rig,
    *,
    workers: int | None = None,
    check: str = "first",
    then: Then | None = None,
    limit_s: float | None = None,
    profile: str = "precise",
    disparities: Range = "auto",
    backend: str | None = None,
    window: Window | None = None,
    reference: str = "right",
    rectangle: Rectangle | None = None,
    depth: tuple[float, float] | None = None,
    mesh: MeshOptions | None = None,
    tile: int | None = None,
    ignore_check: bool = False,
) -> Generator[Outcome]:
    """Reconstruct many raw pairs of one rig, several at once, each in a process of its own.

    A pair that fails, or takes its process with it, fails alone. No more than two pairs a worker are under way or wait
    to be taken, whatever their number: `pairs` may be a generator without end. Whoever stops early closes the iterator,
    or leaves it to be collected; the processes end within a second or so.

    Args:
        pairs: (left, right), or (left, right, mask): the raw pictures or their files, and (H, W) on the rectified
            reference view, 0 where nothing is wanted. Give files where you can: each process reads its own.
        rig: of all pairs.
        workers: how many processes; None for one a core, on a GPU no more than eight.
        check: "first" checks the rig in full against the first pair, and of the others the rows of their maps, which
            takes a hundredth of the time, and in full where these are not plainly right; "every" checks all in full;
            "never" none.
        then: called in the process with the pair's index and its `Reconstruction`; what it returns takes the place of
            the result, so that 10 MB need not be sent back. A function of a module that can be imported.
        limit_s: seconds after which a pair is given up.
        profile, disparities, backend, window, reference, rectangle, depth, mesh, tile, ignore_check: of every pair, as
            in `reconstruct`.

    Returns:
        Gives an outcome a pair, in the order of the pairs.

    Raises:
        InputError: an option is wrong. What is wrong with a pair stands in its outcome.
        BackendError: the device is missing.
    """
    if check not in CHECKS:
        raise InputError(f"check = {check!r:.60}: give first, every or never")
    refuse_unimportable(then)
    plan_job(profile, disparities, None, window, reference, rectangle, depth, mesh, tile)
    device = open_backend(backend)
    shared = {
        "rig": rig,
        "then": then,
        "options": {
            "profile": profile,
            "disparities": disparities,
            "backend": device.name,
            "window": window,
            "reference": reference,
            "rectangle": rectangle,
            "depth": depth,
            "mesh": mesh,
            "tile": tile,
            "ignore_check": ignore_check,
        },
    }
    jobs = ((index, check_of(check, index), *_parts(index, pair)) for index, pair in enumerate(pairs))
    executor = LocalExecutor(Work(task=reconstruct_one, shared=shared), how_many(workers, device))
    answers = run_in_order(executor, jobs, limits=Limits(seconds=limit_s))
    return _outcomes(answers)


def _outcomes(answers: Generator[Answer]) -> Generator[Outcome]:
    with closing(answers):
        for index, answer in enumerate(answers):
            yield Outcome(index=index, result=answer.result, error=answer.error, seconds=answer.seconds)


def reconstruct_one(
    index: int,
    check: str,
    left: Source,
    right: Source,
    mask: Bytes | None,
    *,
    rig: Rig,
    then: Then | None,
    options: dict[str, Any],
) -> Any:
    """One pair, in its process; arguments as of `reconstruct_many` and `reconstruct`."""
    result = reconstruct(left, right, rig, mask=mask, check=check, **options)
    return result if then is None else then(index, result)


def how_many(workers: int | None, device: Backend) -> int | None:
    """The workers that were asked for, or as many as suit a device; None for one a core."""
    return min(usable_cores(), MOST_ON_A_GPU) if workers is None and device.kind == "gpu" else workers


def check_of(check: str, index: int) -> str:
    """How the pair of this index is checked, in the words of `reconstruct`."""
    return {"first": "rows" if index else "full", "every": "full", "never": "never"}[check]


def refuse_unimportable(then: Then | None) -> None:
    """Refuse what another process cannot import.

    Raises:
        InputError: it is a lambda, a function within another, or one of the script that runs.
    """
    if then is None:
        return
    name = getattr(then, "__qualname__", type(then).__qualname__)
    if getattr(then, "__module__", "") == "__main__" or "<" in name:
        raise InputError(f"then = {name} cannot be imported by another process: put it into a module of its own")


def _parts(index: int, pair: Any) -> tuple[Any, Any, Any]:
    if not isinstance(pair, tuple | list) or len(pair) not in (2, 3):
        raise InputError(f"pair {index} is {pair!r:.60}: give (left, right) or (left, right, mask)")
    left, right, mask = (*pair, None)[:3]
    return left, right, mask
