"""Many listed pairs to a folder each: what is done already is skipped, what fails is listed, nothing is left half."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import secrets
import shutil
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from stereo_gpu.backends import open_backend
from stereo_gpu.batching.pair_list import FAILED_NAME, ListedPair
from stereo_gpu.config import MeshOptions
from stereo_gpu.engines.choose import open_executor
from stereo_gpu.engines.executor import Answer, Executor, Limits, Work
from stereo_gpu.engines.in_order import WAITING_EACH, run_in_order
from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.files import check_writable, write_whole
from stereo_gpu.inputs import hash_file
from stereo_gpu.job import plan_job
from stereo_gpu.mask import mask_from_file
from stereo_gpu.match_options import Range, Window
from stereo_gpu.model_files.texture_file import check_texture_format
from stereo_gpu.pipeline import reconstruct
from stereo_gpu.reconstruct_many import CHECKS, check_of, how_many
from stereo_gpu.rig import Rig

RESULT_NAME = "result.json"
FILES = ("model", "all")
TRIES = {"ray": 3}  # of a pair whose worker is lost, by engine; here a pair that takes its process with it has failed
_STAGING = re.compile(r"\..*[0-9a-f]{12}\.part")


@dataclass(frozen=True, kw_only=True)
class Done:
    """What became of a listed pair.

    Args:
        pair: as it was listed.
        error: why it failed; None where it did not.
        skipped: whether its result was there already, of the same pictures, rig and options.
        triangles: of its model; 0 where it was skipped or failed.
        warnings: what a person should know of it.
        seconds: that it took in its process.
    """

    pair: ListedPair
    error: StereoError | None = None
    skipped: bool = False
    triangles: int = 0
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0


def reconstruct_batch(
    pairs: Sequence[ListedPair],
    rig: Rig,
    out: str | os.PathLike[str],
    *,
    files: str = "model",
    again: bool = False,
    workers: int | None = None,
    check: str = "first",
    limit_s: float | None = None,
    profile: str = "precise",
    disparities: Range = "auto",
    backend: str | None = None,
    window: Window | None = None,
    reference: str = "right",
    depth: tuple[float, float] | None = None,
    mesh: MeshOptions | None = None,
    tile: int | None = None,
    ignore_check: bool = False,
    texture_format: str = "png",
    engine: str = "local",
    address: str | None = None,
) -> Generator[Done]:
    """Reconstruct listed pairs, several at once, and write out/NAME/ for each, whole or not at all.

    A pair whose result.json tells of the same pictures, mask, rig and options is skipped, so that a run which was
    stopped goes on where it was. Pairs that failed stand in out/failed.jsonl when the run ends, however it ends.

    Args:
        pairs: as `list_pairs` gives them.
        rig: of all pairs.
        out: folder, made if missing.
        files: "model" for model.glb and result.json, "all" for everything that `Reconstruction.save` writes.
        again: whether to do what is done once more.
        workers, check, limit_s: as in `reconstruct_many`.
        profile, disparities, backend, window, reference, depth, mesh, tile, ignore_check: as in `reconstruct`.
        texture_format: of model.glb: png, jpeg or webp.
        engine: "local", or "ray" for the nodes of a Ray cluster, which must all see the pictures and `out` under the
            same paths. There a pair whose worker is lost is tried three times, and each node looks for its own device.
        address: of the cluster, HOST:PORT or "auto"; None starts one here.

    Returns:
        Gives what became of each pair, in order. Close it to stop early.

    Raises:
        InputError: an option is wrong, `out` cannot be written or is written to by another batch, or there is no such
            cluster.
        BackendError: the device is missing.
    """
    if check not in CHECKS or files not in FILES:
        raise InputError(f"check = {check!r:.40}, files = {files!r:.40}: give first, every or never, and model or all")
    check_texture_format(texture_format, None)
    plan_job(profile, disparities, None, window, reference, None, depth, mesh, tile)
    out, mesh, limits = Path(out), mesh or MeshOptions(), Limits(seconds=limit_s)
    check_writable(out)
    options = {
        "profile": profile,
        "disparities": disparities,
        "window": window,
        "reference": reference,
        "depth": depth,
        "mesh": mesh,
        "tile": tile,
        "ignore_check": ignore_check,
    }
    told = {**options, "mesh": asdict(mesh), "check": check, "files": files, "texture_format": texture_format}
    distant = engine == "ray"
    device = None if distant else open_backend(backend)
    shared = {
        "rig": rig,
        "out": out.absolute(),
        "options": {**options, "backend": device.name if device else backend or os.environ.get("STEREO_GPU_BACKEND")},
        "saving": {"files": files, "texture_format": texture_format},
        "again": again,
        "wanted": {"rig": _rig_digest(rig), "options": told},
    }
    mark = out.absolute() / f".{secrets.token_hex(6)}.part" if distant else None
    work = Work(task=make_model, shared=shared, prepare=partial(refuse_unshared, mark) if mark else None)
    jobs = ((_whole(pair) if distant else pair, check_of(check, index)) for index, pair in enumerate(pairs))
    executor = open_executor(engine, work, workers=how_many(workers, device) if device else workers, address=address)
    answers = run_in_order(executor, jobs, limits=limits, tries=TRIES.get(engine, 1))
    return _run(pairs, out, mark, executor, answers)


def _run(
    pairs: Sequence[ListedPair], out: Path, mark: Path | None, executor: Executor, answers: Generator[Answer]
) -> Generator[Done]:
    failed: list[str] = []
    with closing(executor), _own(out):
        if mark is not None:
            mark.mkdir()
        waiting = deque(pairs)
        try:
            with closing(answers):
                for answer in answers:
                    pair = waiting.popleft()
                    if answer.error is not None:
                        failed.append(_failure(pair, answer.error))
                        yield Done(pair=pair, error=answer.error, seconds=answer.seconds)
                    else:
                        yield Done(pair=pair, seconds=answer.seconds, **answer.result)
        finally:
            for folder in (out, *(out / pair.name for pair in islice(waiting, WAITING_EACH * executor.slots))):
                _clear(folder)
            listed = out / FAILED_NAME
            if failed:
                write_whole(listed, "".join(failed))
            else:
                listed.unlink(missing_ok=True)


def refuse_unshared(mark: Path, **_: Any) -> None:
    """Refuse, on a node, to write models to a folder that is not the caller's own.

    Raises:
        InputError: `mark`, a folder in it, is not to be seen here.
    """
    if not mark.is_dir():
        raise InputError(
            f"{mark.parent} is another folder on {platform.node()}: put it on storage that all nodes share"
        )


def _whole(pair: ListedPair) -> ListedPair:
    """The pair by paths that do not depend on where a process runs."""
    mask = None if pair.mask is None else pair.mask.absolute()
    return replace(pair, left=pair.left.absolute(), right=pair.right.absolute(), mask=mask)


def make_model(
    pair: ListedPair,
    check: str,
    *,
    rig: Rig,
    out: Path,
    options: dict[str, Any],
    saving: dict[str, Any],
    again: bool,
    wanted: dict[str, Any],
) -> dict[str, Any]:
    """One pair, in its process: fields of `Done`."""
    folder = out / pair.name
    digest = _digest(pair, wanted)
    if not again and _is_done(folder, digest):
        return {"skipped": True}
    mask = None if pair.mask is None else mask_from_file(pair.mask, rig.left.size)
    result = reconstruct(pair.left, pair.right, rig, mask=mask, check=check, **options)
    also = {"batch": {"name": pair.name, "digest": digest}}
    if folder.exists():
        _clear(folder)
        result.save(folder, also=also, **saving)
    else:
        # The folder appears with all that is in it.
        staging = out / f".{pair.name}.{secrets.token_hex(6)}.part"
        try:
            result.save(staging, also=also, **saving)
            staging.rename(folder)
        except OSError as error:
            # An earlier try of the pair, whose node was thought lost, may have been quicker.
            if not _is_done(folder, digest):
                raise InputError(f"cannot write {folder}: {error.strerror or error}; name another folder") from error
        finally:
            shutil.rmtree(staging, ignore_errors=True)
    return {"triangles": len(result.mesh.faces), "warnings": tuple(result.warnings)}


def _digest(pair: ListedPair, wanted: dict[str, Any]) -> str | None:
    """A hash of all that decides the result; None where a picture cannot be read, which the pipeline then tells."""
    named = {"left": pair.left, "right": pair.right, **({"mask": pair.mask} if pair.mask else {})}
    try:
        inputs = {name: hash_file(path) for name, path in named.items()}
    except (OSError, ValueError):
        return None
    return hashlib.sha256(json.dumps({**wanted, "inputs": inputs}, sort_keys=True, default=float).encode()).hexdigest()


def _is_done(folder: Path, digest: str | None) -> bool:
    """Whether a result of just this is there."""
    try:
        record = json.loads((folder / RESULT_NAME).read_text("utf-8"))
        return digest is not None and record["batch"]["digest"] == digest and (folder / "model.glb").is_file()
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _rig_digest(rig: Rig) -> str:
    cameras = [(camera.matrix.tolist(), camera.distortion.tolist(), camera.size) for camera in (rig.left, rig.right)]
    return hashlib.sha256(json.dumps([cameras, rig.R.tolist(), rig.T.tolist(), rig.unit]).encode()).hexdigest()


def _failure(pair: ListedPair, error: StereoError) -> str:
    """A line of failed.jsonl, which is a manifest too, wherever it lies."""
    files = {"left": pair.left, "right": pair.right, **({"mask": pair.mask} if pair.mask else {})}
    whole = {side: str(file.absolute()) for side, file in files.items()}
    return json.dumps({"name": pair.name, **whole, "error": str(error)}) + "\n"


def _clear(folder: Path) -> None:
    """Remove what a process that was killed had not finished."""
    for part in folder.iterdir() if folder.is_dir() else ():
        if _STAGING.fullmatch(part.name) and part.is_dir():
            shutil.rmtree(part, ignore_errors=True)


@contextmanager
def _own(out: Path) -> Iterator[None]:
    """Keep a second batch out of the folder until this one ends, however it ends; the folder is made if missing."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        held = os.open(out, os.O_RDONLY) if os.name == "posix" else None
    except OSError as error:
        raise InputError(f"cannot write to {out}: {error.strerror or error}; name another folder") from error
    try:
        if held is not None:
            _lock(out, held)
        _clear(out)
        yield
    finally:
        if held is not None:
            os.close(held)


def _lock(out: Path, held: int) -> None:
    import fcntl

    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(f"another batch writes to {out}: wait for it, or name another folder") from error
    except OSError:  # a file system that knows no locks
        return
