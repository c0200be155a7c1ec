import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.service.data import folders as folders_module
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.data.manifest import read_manifest, seal
from stereo_gpu.service.refusals import DiskFull, NotFound, StoreError

ID, OTHER = "0f" * 16, "1e" * 16


@pytest.fixture
def folders(tmp_path):
    folders = Folders(tmp_path / "data")
    with folders.own():
        yield folders


def accept(folders, id=ID, content=b"picture"):
    upload = folders.new_upload()
    (upload / "left.png").write_bytes(content)
    folders.accept(upload, id)
    return upload


def make_attempt(folders, number=1, content=b"model", id=ID):
    attempt = folders.attempt(id, number)
    attempt.mkdir(parents=True)
    (attempt / "model.glb").write_bytes(content)
    (attempt / "result.json").write_text("{}")
    seal(attempt)
    return attempt


def tree(folders):
    return sorted(str(path.relative_to(folders.root)) for path in folders.root.rglob("*") if path.is_file())


def age(path, seconds):
    then = time.time() - seconds
    os.utime(path, (then, then))


def test_paths_come_from_ids_alone(folders):
    for id in ("", ".", "..", "../" + ID, ID[:-1], ID + "0", ID.upper(), ID + "\n", "x" * 32, "é" * 32, "\0" * 32):
        for path in (folders.job, folders.inputs, folders.result, folders.steps, folders.rig, folders.outline):
            with pytest.raises(NotFound, match="ids are 32 hexadecimal digits"):
                path(id)
        with pytest.raises(NotFound):
            folders.attempt(id, 1)
    for step in ("", "..", "../x", "a/b", "A", "x" * 50):
        with pytest.raises(NotFound, match="no step"):
            folders.step(ID, step)
    assert folders.step(ID, "rectified") == folders.root / "jobs" / ID / "steps" / "rectified.jpg"
    assert folders.rig(ID) == folders.root / "rigs" / ID / "rig.json"


def test_everything_is_its_owners_alone(folders):
    folders.keep_token("secret")
    assert folders.token_file.read_text() == "secret\n"
    assert folders.token_file.stat().st_mode & 0o777 == 0o600
    for folder in (folders.root, folders.jobs, folders.rigs, folders.outlines, folders.uploads, folders.new_upload()):
        assert folder.stat().st_mode & 0o777 == 0o700


def test_one_service_a_folder_even_after_one_was_killed(tmp_path):
    root = tmp_path / "data"
    holder = f"""
import sys, time
from stereo_gpu.service.data.folders import Folders
with Folders({str(root)!r}).own():
    print("held", flush=True)
    time.sleep(60)
"""
    process = subprocess.Popen([sys.executable, "-c", holder], stdout=subprocess.PIPE)
    try:
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(InputError, match=f"process {process.pid} serves .* already: end it") as told:
            with Folders(root).own():
                pass
        assert "\n" not in str(told.value)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    with Folders(root).own():
        pass


def test_a_disk_that_is_full_keeps_nobody_from_starting(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with Folders(tmp_path / "data").own():
        pass


def test_folders_of_others_are_left_alone(tmp_path):
    (tmp_path / "jobs").mkdir()
    (tmp_path / "jobs" / "mine.txt").write_text("x")
    with pytest.raises(InputError, match="holds other files, such as jobs: name a new or an empty folder"):
        with Folders(tmp_path).own():
            pass
    assert [path.name for path in tmp_path.rglob("*")] == ["jobs", "mine.txt"]
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="cannot write to"):
        with Folders(tmp_path / "file").own():
            pass


def test_an_upload_becomes_the_inputs_of_a_job(folders):
    upload = accept(folders)
    assert not upload.exists() and tree(folders) == [f"jobs/{ID}/inputs/left.png", "lock"]
    with pytest.raises(StoreError, match="File exists"):
        accept(folders, content=b"other")
    assert (folders.inputs(ID) / "left.png").read_bytes() == b"picture"


def test_a_full_disk_is_told_as_such(folders, monkeypatch):
    def full(path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folders_module, "flush_file", full)
    with pytest.raises(DiskFull, match="the disk is full; make room"):
        accept(folders)
    assert not folders.job(ID).exists()


def test_a_rig_that_does_not_fit_on_the_disk_is_told_as_such(folders):
    def write(path):
        try:
            raise OSError(28, "No space left on device")
        except OSError as error:
            raise InputError("cannot write") from error

    folders.keep_rig(ID, lambda path: path.write_text("{}"))
    with pytest.raises(DiskFull, match="the disk is full; make room"):
        folders.keep_rig(ID, write)
    assert folders.rig(ID).read_text() == "{}"


def test_a_sealed_folder_tells_of_all_that_is_in_it(folders):
    attempt = make_attempt(folders, content=b"model")
    manifest = read_manifest(attempt)
    model = manifest.file("model.glb")
    assert (model.bytes, model.sha256, model.type) == (5, hashlib.sha256(b"model").hexdigest(), "model/gltf-binary")
    assert [file.name for file in manifest.files] == ["model.glb", "result.json"] and manifest.bytes == 7
    for name in ("manifest.json", "../inputs/left.png", "", "none.glb"):
        with pytest.raises(NotFound, match="no file"):
            manifest.file(name)
    assert seal(attempt) == manifest  # once more is the same


def test_only_plain_files_can_be_sealed(folders):
    for make in (
        lambda path: path.mkdir(),
        lambda path: path.symlink_to("/etc/passwd"),
        os.mkfifo,
    ):
        attempt = folders.attempt(ID, 1)
        attempt.mkdir(parents=True, exist_ok=True)
        make(attempt / "odd.png")
        with pytest.raises(StoreError, match="cannot be part of a result"):
            seal(attempt)
        assert read_manifest(attempt) is None
        folders.clear(ID)


@pytest.mark.parametrize(
    "content",
    ["", "{", "[]", "{}", '{"version": 1, "files": [{"name": 3}]}', '{"version": 2, "files": []}', "[" * 9999],
)
def test_a_broken_manifest_is_none(tmp_path, content):
    (tmp_path / "manifest.json").write_text(content)
    assert read_manifest(tmp_path) is None


def test_a_manifest_reads_nothing_outside_of_its_folder(tmp_path):
    (tmp_path / "secret").write_text("x")
    inside = tmp_path / "result"
    inside.mkdir()
    file = {"name": "../secret", "bytes": 1, "sha256": "", "type": ""}
    (inside / "manifest.json").write_text(json.dumps({"version": 1, "files": [file]}))
    assert read_manifest(inside) is None


def test_contents_reach_the_disk_before_their_names(folders, monkeypatch):
    """A power cut at any moment leaves no result without its contents: the order of what is flushed and named."""
    steps = []
    flush, rename, replace = os.fsync, Path.rename, Path.replace

    def name_of(held):
        same = (path for path in folders.root.rglob("*") if os.path.samestat(path.stat(), os.fstat(held)))
        return next(same, folders.root).name

    monkeypatch.setattr(os, "fsync", lambda held: (steps.append(name_of(held)), flush(held)))
    monkeypatch.setattr(Path, "rename", lambda path, to: (steps.append(f"-> {to.name}"), rename(path, to))[1])
    monkeypatch.setattr(Path, "replace", lambda path, to: (steps.append(f"-> {to.name}"), replace(path, to))[1])
    upload = accept(folders)
    assert steps == ["left.png", upload.name, "-> inputs", ID, "jobs"]
    steps.clear()
    attempt = folders.attempt(ID, 1)
    attempt.mkdir()
    (attempt / "model.glb").write_bytes(b"model")
    seal(attempt)
    part = steps.pop(1)  # the manifest under its temporary name
    assert part.startswith(".manifest.json") and steps == ["model.glb", "-> manifest.json", "try-1.part"]
    steps.clear()
    folders.publish(ID, 1)
    assert steps == ["-> result", ID]


def test_a_result_takes_its_place_in_one_step(folders):
    accept(folders)
    make_attempt(folders, 1, b"first")
    made = make_attempt(folders, 2, b"second")
    assert folders.manifest(ID) is None
    published = folders.publish(ID, 2)
    result = len(b"second{}") + (folders.result(ID) / "manifest.json").stat().st_size
    assert folders.bytes(ID) == len(b"picture") + result and folders.bytes(OTHER) == 0
    assert published == folders.manifest(ID) and published.file("model.glb").bytes == 6
    assert not made.exists() and sorted(part.name for part in folders.job(ID).iterdir()) == ["inputs", "result"]
    make_attempt(folders, 3, b"third")
    assert folders.publish(ID, 3) == published  # what is there and whole stays
    assert folders.publish(ID, 3) == published and not folders.attempt(ID, 3).exists()


def test_a_result_that_is_not_whole_gives_way(folders):
    accept(folders)
    make_attempt(folders, 1, b"first")
    folders.publish(ID, 1)
    (folders.result(ID) / "model.glb").write_bytes(b"cut")
    assert folders.manifest(ID) is None
    with pytest.raises(StoreError, match="is not whole"):
        folders.publish(ID, 2)
    make_attempt(folders, 2, b"second")
    assert folders.publish(ID, 2).file("model.glb").bytes == 6 and folders.manifest(ID) is not None


def test_a_try_that_is_not_sealed_is_not_published(folders):
    accept(folders)
    attempt = folders.attempt(ID, 1)
    attempt.mkdir()
    (attempt / "model.glb").write_bytes(b"half")
    with pytest.raises(StoreError, match="is not whole"):
        folders.publish(ID, 1)
    assert not folders.result(ID).exists()


def test_what_is_removed_is_gone_for_good(folders):
    accept(folders)
    folders.remove_job(ID)
    folders.remove_job(ID)
    folders.rig(OTHER).parent.mkdir()
    folders.rig(OTHER).write_text("{}")
    folders.remove_rig(OTHER)
    folders.remove_rig(OTHER)
    assert tree(folders) == ["lock"] and list(folders.uploads.iterdir()) == []


def test_the_sweep_takes_what_nobody_knows_and_is_old(folders):
    known, unknown, busy, young = (digit * 32 for digit in "abcd")
    for id in (known, unknown, busy, young):
        accept(folders, id)
        make_attempt(folders, 1, id=id)
        make_attempt(folders, 2, id=id)
        for part in (folders.attempt(id, 1), folders.job(id)):
            age(part, 100)
    age(folders.attempt(known, 2), 100)
    age(folders.job(known), 100)
    age(folders.job(young), 0)
    rig, upload, fresh, view = (
        folders.rig(OTHER).parent,
        folders.new_upload(),
        folders.new_upload(),
        folders.outline(ID),
    )
    for part in (rig, view):
        part.mkdir()
    for part in (rig, upload, view):
        (part / "file").write_text("x")
        age(part, 100)
    foreign = [folders.jobs / "notes", folders.uploads / "notes.txt", folders.rigs / "README"]
    for part in foreign:
        part.write_text("x")
        age(part, 100)
    assert folders.sweep({known, busy}, time.time() - 50, busy={busy}) == 6
    left = {path.name for path in folders.jobs.iterdir()}
    assert left == {known, busy, young, "notes"} and all(part.exists() for part in foreign)
    assert [part.name for part in sorted(folders.job(known).iterdir())] == ["inputs"]
    assert [part.name for part in sorted(folders.job(busy).iterdir())] == ["inputs", "try-1.part", "try-2.part"]
    assert fresh.exists() and not (rig.exists() or upload.exists() or view.exists())


MOVER = """
import itertools, sys
from pathlib import Path
from stereo_gpu.service.data.folders import Folders

folders = Folders(sys.argv[1])
for number in itertools.count(int(sys.argv[2])):
    id = f"{number:032x}"
    upload = folders.new_upload()
    for name in ("left.png", "right.png"):
        (upload / name).write_bytes(bytes(5000))
    folders.accept(upload, id)
    print(number, flush=True)
    for attempt in (1, 2):
        folder = folders.attempt(id, attempt)
        folder.mkdir()
        (folder / "model.glb").write_bytes(bytes(20_000 + attempt))
        folders.seal(folder)
    folders.publish(id, 2)
    print(number, "published", flush=True)
    if number % 3 == 0:
        folders.remove_job(id)
"""


def test_whatever_is_killed_nobody_sees_half_of_anything(folders):
    first = 0
    for kill_after in (1, 2, 5, 12, 24, 31):
        command = [sys.executable, "-c", MOVER, str(folders.root), str(first)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as mover:
            try:
                lines = [mover.stdout.readline() for _ in range(kill_after)]
            finally:
                mover.kill()
            lines += mover.stdout.readlines()
        assert mover.returncode == -signal.SIGKILL, "it ended by itself"
        told = [line.decode().split() for line in lines]
        published = {int(words[0]) for words in told if len(words) == 2}
        for number in {int(words[0]) for words in told}:
            id = f"{number:032x}"
            if number in published and number % 3 == 0:
                continue  # it was about to be removed
            assert sorted(file.stat().st_size for file in folders.inputs(id).iterdir()) == [5000, 5000]
            assert folders.manifest(id) is not None or number not in published
        for job in folders.jobs.iterdir():
            inputs, result = job / "inputs", job / "result"
            assert not inputs.exists() or len(list(inputs.iterdir())) == 2
            assert not result.exists() or read_manifest(result).file("model.glb").bytes == 20_002
        first = max(first, *(int(path.name, 16) for path in folders.jobs.iterdir()), *published) + 1
    known = {path.name for path in folders.jobs.iterdir() if folders.manifest(path.name)}
    folders.sweep(known, time.time() + 5)
    assert list(folders.uploads.iterdir()) == [] and {path.name for path in folders.jobs.iterdir()} == known
    assert all(sorted(part.name for part in folders.job(id).iterdir()) == ["inputs", "result"] for id in known)


def test_what_a_killed_service_was_being_sent_goes_with_the_next(tmp_path):
    folders = Folders(tmp_path / "data")
    with folders.own():
        upload = folders.new_upload()
        (upload / "left.png").write_bytes(b"half")
        (folders.uploads / "not ours").mkdir()
    with folders.own():
        assert [part.name for part in folders.uploads.iterdir()] == ["not ours"]
