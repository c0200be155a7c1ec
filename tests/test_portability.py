"""tools/portability: what counts as a pass, and what it says of a runtime that fails, crashes or is not there."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
portability = pytest.importorskip("portability", reason="needs the checkout's tools")

DOTS = "........................................ [100%]\n"


@pytest.mark.parametrize(
    ("status", "output", "good", "said"),
    [
        (0, DOTS + "180 passed in 61.20s (0:01:01)\n", True, "180 passed"),
        (0, DOTS + "178 passed, 2 skipped, 9 deselected in 3.10s\n", True, "178 passed, 2 skipped"),
        # A driver that prints as it is unloaded, and pytest without -q.
        (0, DOTS + "===== 8 passed, 1 warning in 0.20s =====\npool freed\n\nbye\n", True, "8 passed"),
        (0, DOTS + "3 passed, 180 skipped in 1.00s\n", False, "3 passed, 180 skipped: too few ran"),
        (0, "180 skipped in 1.00s\n", False, "180 skipped"),
        (1, "FAILED x - 2 passed in 1s\n1 failed, 179 passed in 9.00s\n", False, "179 passed, 1 failed"),
        (1, "2 errors in 0.50s\n", False, "2 error"),
        # All passed, and then the driver failed as it was unloaded.
        (3, DOTS + "180 passed in 9.00s\n", False, "180 passed"),
        (5, "9 deselected in 0.10s\n", False, "no test ran"),
        (5, "no tests ran in 0.01s\n", False, "no test ran"),
        (-11, "", False, "crashed (signal 11, SIGSEGV)"),
        (-6, ".....", False, "crashed (signal 6, SIGABRT)"),
        (-40, "", False, "crashed (signal 40"),
        (1, "", False, "no result (exit status 1)"),
        (4, "ERROR: file or directory not found\n", False, "no result (exit status 4)"),
        (134, "\n", False, "crashed (signal 6, SIGABRT)"),
    ],
)
def test_verdict(status, output, good, said):
    found = portability.verdict(status, output)
    assert found[0] == good
    counts = dict(reversed(part.split()) for part in said.split(": ")[0].split(", ")) if said[0].isdigit() else {}
    assert all(f"{number} {what}" in found[1] for what, number in counts.items()) if counts else said in found[1]
    assert ("too few" in said) == ("too few" in found[1])


def runtime(name, library):
    return portability.Runtime(name, name, "Nothing", library, "install it")


def call(monkeypatch, *arguments, library=None):
    monkeypatch.setattr(sys, "argv", ["portability", *arguments])
    monkeypatch.setattr(portability, "runtimes", lambda: [runtime("one", library), runtime("two", None)])
    return portability.main()


def test_an_unknown_name_gets_one_line(monkeypatch, capsys):
    with pytest.raises(SystemExit) as left:
        call(monkeypatch, "three")
    assert left.value.code == 2
    assert "invalid choice: 'three'" in capsys.readouterr().err.strip().split("\n")[-1]


@pytest.mark.parametrize("names", [(), ("two",), ("one", "two")])
def test_where_nothing_is_there_nothing_passes(monkeypatch, capsys, names):
    assert call(monkeypatch, *names) == 1
    table, complaint = capsys.readouterr()
    assert len(table.strip().split("\n")) == 1 + (len(names) or 2)
    assert table.count("not there") == (len(names) or 2)
    assert "none of these runtimes is there" in complaint


@pytest.mark.parametrize(("status", "output"), [(0, "9 passed in 1.00s\n"), (-11, "")])
def test_a_crash_is_a_row_of_the_table(monkeypatch, capsys, tmp_path, status, output):
    class Done:
        returncode, stdout, stderr = status, output, ""

    monkeypatch.setattr(portability, "device_of", lambda runtime, folder: "device | 1.0")
    monkeypatch.setattr(portability.subprocess, "run", lambda *command, **options: Done)
    # The other runtime is not there, which is a failure only where it is named.
    assert call(monkeypatch, library=tmp_path / "lib.so") == (status != 0)
    lines = capsys.readouterr().out.strip().split("\n")
    assert len(lines) == 3 and ("FAILED: crashed (signal 11" in lines[1]) == (status != 0)
    assert "not there" in lines[2]
