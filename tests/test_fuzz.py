"""tools/fuzz: some damaged files for every reader, and that a reader that fails is found out."""

import os
import random
import signal
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
fuzz = pytest.importorskip("fuzz", reason="needs the checkout's tools")
from fuzz_mutate import mutate  # noqa: E402
from fuzz_seeds import SHARED, Reader, readers  # noqa: E402

READERS = readers()
CASES = 100
# A child is forked from a process that may have threads by now; it reads files and nothing else.
FORKS = pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_taken_or_refused(name, tmp_path):
    reader = READERS[name]
    told = [fuzz.read(fuzz.make_case(reader, 5, number), tmp_path, number) for number in range(CASES)]
    assert "" in told[len(reader.seeds) :]  # some damage does no harm,
    assert len(set(told)) > 10  # and the rest is refused for many reasons


@pytest.mark.parametrize("name", READERS)
def test_every_seed_is_a_calibration(name, tmp_path):
    for number, case in enumerate(READERS[name].seeds):
        for size in ((640, 480), None):
            try:
                fuzz.sg.load_rig(*_put(tmp_path, case), size=size)
                break
            except fuzz.InputError as error:
                assert "640" in str(error), number


def _put(folder, case):
    for name, data in case.items():
        (folder / name).write_bytes(data)
    return [folder / name for name in case]


def test_damage_is_the_same_for_the_same_number():
    for reader in READERS.values():
        assert [fuzz.make_case(reader, 1, 50) for _ in range(2)] == [fuzz.make_case(reader, 1, 50)] * 2
    for number in range(500):  # the damage itself has to bear every file
        assert fuzz.make_case(READERS["matlab"], 31, number)
    data = READERS["kitti"].seeds[0]["calib.txt"]
    assert len({mutate(random.Random(number), data, [data]) for number in range(50)}) > 45


FAULTS = {
    "crash": lambda: os.kill(os.getpid(), signal.SIGKILL),
    "hang": lambda: [None for _ in iter(int, 1) if time.time() < 0],
    "memory": lambda: bytearray(4 * fuzz.MEMORY),
    "error": lambda: [][0],
}


@FORKS
@pytest.mark.parametrize(
    ("fault", "told"),
    [("crash", "exit status -9"), ("hang", "took too long"), ("memory", "MemoryError"), ("error", "IndexError")],
)
def test_a_reader_that_fails_is_found_and_the_next_file_is_read(monkeypatch, fault, told):
    monkeypatch.setattr(fuzz, "SECONDS", 0.2)
    monkeypatch.setattr(fuzz, "BATCH", 5)
    monkeypatch.setattr(fuzz, "read", lambda case, folder, number: FAULTS[fault]() and "" if number == 3 else "fine")
    reader = Reader(("rig_files/tree",), [{"a.txt": b"1"}])
    outcome = fuzz.fuzz(reader, 60, 1, 12)
    found = [(name, number) for name, number in outcome.failures.items() if told in name]
    assert [number for _, number in found] == [3]
    assert sum(outcome.refused.values()) >= 8  # what its child read of that batch is lost with it


@FORKS
def test_the_table_and_what_is_kept(monkeypatch, capsys, tmp_path):
    assert fuzz.main(["--files", "300", "--reader", "middlebury", "--reasons", "1"]) == 0
    out = capsys.readouterr().out
    assert "middlebury" in out
    assert " 300 " in out
    monkeypatch.setattr(fuzz, "read", lambda *_: [][0])
    assert fuzz.main(["--files", "10", "--reader", "kitti", "--keep", str(tmp_path / "kept")]) == 1
    assert "FAILED, kept in" in capsys.readouterr().out
    assert (tmp_path / "kept" / "kitti_1_0" / "calib.txt").read_bytes() == READERS["kitti"].seeds[0]["calib.txt"]


def test_lines_that_count():
    lines = fuzz.code_lines(READERS["middlebury"])
    assert {Path(file).name for file, _ in lines} == {"middlebury.py", "text_lines.py"}
    source = (fuzz.ROOT / "stereo_gpu/rig_files/text_lines.py").read_text().splitlines()
    texts = {source[line - 1].strip() for file, line in lines if file.endswith("text_lines.py")}
    assert "found: dict[str, Tree] = {}" in texts
    assert not any(text.startswith(("def ", "import ", '"""')) for text in texts)
    assert len(fuzz.code_lines(Reader(SHARED, []))) > 200
