import os
import resource
import stat

import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.files import check_writable, check_writable_file, whole_folder, write_whole


def test_writes_text_and_bytes(tmp_path):
    assert write_whole(tmp_path / "a.txt", "Ä\n").read_bytes() == "Ä\n".encode()
    assert write_whole(tmp_path / "b.bin", b"\x00\xff").read_bytes() == b"\x00\xff"


def test_others_may_read_as_far_as_the_umask_allows(tmp_path):
    before = os.umask(0o022)
    try:
        path = write_whole(tmp_path / "a", b"1")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o644


def test_follows_a_link(tmp_path):
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "real").write_text("old")
    (tmp_path / "link").symlink_to("folder/real")
    write_whole(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "folder" / "real").read_text() == "new"


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "model.bin"
    path.write_text("old")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # the nearest thing to a full disk
    try:
        with pytest.raises(InputError, match=r"model\.bin \(5000 bytes\)"):
            write_whole(path, b"x" * 5000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["model.bin"]


def test_a_folder_that_cannot_take_the_file(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="no folder"):
        write_whole(tmp_path / "missing" / "a", b"")
    with pytest.raises(InputError, match="no folder"):
        write_whole(tmp_path / "file" / "a", b"")
    with pytest.raises(InputError, match="is a folder"):
        write_whole(tmp_path, b"")
    with pytest.raises(InputError, match="cannot write"):
        write_whole("/proc/a", b"")


def test_a_folder_gets_all_of_its_files_or_none(tmp_path):
    with whole_folder(tmp_path / "a" / "b") as new:
        (new / "1.txt").write_text("one")
        (new / "2.txt").write_text("two")
        assert new.parent == tmp_path / "a" / "b" and not (tmp_path / "a" / "b" / "1.txt").exists()
    assert sorted(path.name for path in (tmp_path / "a" / "b").iterdir()) == ["1.txt", "2.txt"]
    with pytest.raises(ZeroDivisionError), whole_folder(tmp_path / "a" / "b") as new:
        (new / "1.txt").write_text("changed")
        raise ZeroDivisionError
    assert (tmp_path / "a" / "b" / "1.txt").read_text() == "one"
    with pytest.raises(ZeroDivisionError), whole_folder(tmp_path / "c" / "d") as new:
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_folders_that_cannot_be_written_are_told_by_trying(tmp_path):
    (tmp_path / "file").write_text("")
    check_writable(tmp_path / "new" / "deeper")
    for folder, says in (
        (tmp_path / "file", "is a file; name another folder"),
        (tmp_path / "file" / "new", "is a file; name another folder"),
        ("/proc/new", "cannot write to /proc/new"),
        (tmp_path / ("x" * 300), "too long"),
    ):
        with pytest.raises(InputError, match=says):
            check_writable(folder)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_files_that_cannot_be_written_are_told_before(tmp_path):
    check_writable_file(tmp_path / "rig.json")
    for path, says in (
        (tmp_path, "is a folder: name a file in it"),
        (tmp_path / "no" / "rig.json", "there is no folder"),
        ("/proc/rig.json", "cannot write to /proc"),
    ):
        with pytest.raises(InputError, match=says):
            check_writable_file(path)
    assert not list(tmp_path.iterdir())


def test_names_that_no_file_can_have(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/null")
    for name, says in (
        ("pipe", "is a device or pipe: name a file"),
        ("link", "is a device or pipe: name a file"),
        ("a\0b", "embedded null byte; name another file"),
        ("x" * 300, "too long; name another file"),
    ):
        for attempt in (lambda path: write_whole(path, b"new"), check_writable_file):
            with pytest.raises(InputError, match=says):
                attempt(tmp_path / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "pipe"]
    assert stat.S_ISCHR((tmp_path / "link").stat().st_mode)
