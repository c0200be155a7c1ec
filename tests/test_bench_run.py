"""A run of the benchmark: what follows from its times, its file, what got slower, and the command line over them."""

import dataclasses
import json

import pytest
from bench_runs import made_up_run
from conftest import need_matplotlib

from stereo_gpu.bench.compare import compare, comparison_lines
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.report import number, report_lines
from stereo_gpu.cli import main
from stereo_gpu.errors import InputError


@pytest.fixture
def saved(tmp_path):
    """A function that keeps a run and gives the name of its file."""

    def save(name, run):
        run.save(tmp_path / name)
        return str(tmp_path / name)

    return save


def test_what_follows_from_the_times():
    run = made_up_run()
    found = next(r for r in run.rows if r.name == "ncc_wta")
    cells = 640 * 480 * 64
    # A kernel's speed is that on the device, its ratios are of wall times.
    assert found.evaluations_s == pytest.approx(cells / 0.0032)
    assert found.bytes_s == pytest.approx(42 * 640 * 480 / 0.0032)
    assert run.share_of_copy(found) == pytest.approx(42 * 640 * 480 / 0.0032 / 50e9)
    assert found.to_peer == found.to_stereobm == pytest.approx(0.4)
    profile = next(r for r in run.rows if r.name == "match fast")
    assert profile.evaluations_s == pytest.approx(cells / 0.009)
    assert profile.to_peer == pytest.approx(0.75)
    grey = next(r for r in run.rows if r.name == "grey")
    assert grey.evaluations_s is None and grey.to_peer is None and grey.to_stereobm == pytest.approx(0.05)


def test_a_file_brings_everything_back(tmp_path):
    run = made_up_run()
    run.save(tmp_path / "run.json")
    assert BenchRun.load(tmp_path / "run.json") == run
    held = json.loads((tmp_path / "run.json").read_text("utf-8"))
    assert held["format"] == "stereo-gpu bench"
    derived = next(r for r in held["rows"] if r["name"] == "ncc_wta")["derived"]
    assert derived["to_stereobm"] == pytest.approx(0.4)


def test_the_report_shows_figures_and_reasons():
    lines = list(report_lines(made_up_run()))
    fused = next(line for line in lines if line.split()[:1] == ["ncc_wta"])
    assert fused.split()[1:] == [
        "3.20",
        "4.00",
        "30%",
        "-",
        "6.14",
        "96.0",
        "4.03",
        "8.1%",
        "0.40",
        "0.40",
        "x",
        "StereoBM",
    ]
    assert any("match precise" in line and "not run: needs 9 bytes" in line for line in lines)
    assert max(map(len, lines[4:12])) < 150


@pytest.mark.parametrize(
    ("value", "words"),
    [(None, "-"), (12345.6, "12,346"), (123.4, "123"), (99.96, "100"), (12.34, "12.3"), (1.234, "1.23"), (0.1, "0.10")],
)
def test_numbers(value, words):
    assert number(value) == words
    assert number(0.00012345) == "0.00012"


def test_compares_ratios_to_stereobm_not_times():
    # All takes twice as long, StereoBM too: nothing got slower.
    found = compare(made_up_run(), made_up_run(slowdown=2.0, stereobm=0.02))
    assert not found.slower
    assert all(change.relative and change.factor == pytest.approx(1) for change in found.changes)
    assert "12 cases compared, 12 of them within 5% of before" in list(comparison_lines(found))


def test_tells_what_got_slower():
    found = compare(made_up_run(), made_up_run(slowdown=1.3), limit=1.15)
    assert {change.row.name for change in found.slower} == {"ncc_wta", "grey", "match fast"}
    line = next(line for line in comparison_lines(found) if "ncc_wta on opencl:one, 640" in line)
    assert line.split()[:3] == ["1.30", "times", "slower:"] and "0.4 -> 0.52 x StereoBM" in line
    assert not compare(made_up_run(), made_up_run(slowdown=1.3), limit=1.4).slower
    faster = compare(made_up_run(slowdown=1.3), made_up_run())
    assert not faster.slower
    assert any("1.30 times faster" in line for line in comparison_lines(faster))


def test_compares_times_where_there_is_no_stereobm():
    def without(run):
        return dataclasses.replace(run, rows=tuple(dataclasses.replace(r, stereobm_wall=None) for r in run.rows))

    found = compare(without(made_up_run()), without(made_up_run(slowdown=2.0, stereobm=0.02)))
    assert len(found.slower) == len(found.changes) and not found.changes[0].relative


def test_tells_what_is_missing_and_that_machines_differ():
    found = compare(made_up_run(), made_up_run(machine="another", devices=("opencl:one",)))
    assert not found.same_machine and len(found.missing) == 6
    lines = list(comparison_lines(found))
    assert any("different machines" in line for line in lines)
    assert any(line.startswith("not in this run: 6 cases (ncc_wta on warp:cpu") for line in lines)


def without_times(run, note, names=("grey",)):
    """The run with some of its cases not run, for a reason."""
    rows = (
        dataclasses.replace(r, wall=None, on_device=None, stereobm_wall=None, note=note) if r.name in names else r
        for r in run.rows
    )
    return dataclasses.replace(run, rows=tuple(rows))


@pytest.mark.parametrize("names", [("grey",), ("ncc_wta", "grey", "match fast")])
def test_a_case_that_runs_no_more_is_past_the_limit(saved, capsys, names):
    broken = without_times(made_up_run(), "not run: kernel grey does not compile", names)
    old, new = saved("old.json", made_up_run()), saved("new.json", broken)
    assert main(["bench", "--load", new, "--compare", old]) == 1
    said = capsys.readouterr()
    assert "ran before: grey on warp:cpu, 640 x 480 x 64: not run: kernel grey does not compile" in said.out
    assert said.err.count("\n") == 1
    assert f"{4 * len(names)} cases that ran in {old} run no more: " in said.err
    assert "grey (not run: kernel grey does not compile)" in said.err
    # What did not run before either is no loss.
    assert main(["bench", "--load", new, "--compare", new]) == (0 if names == ("grey",) else 2)


def test_a_case_without_a_time_or_a_reason_is_past_the_limit(saved, capsys):
    old, new = saved("old.json", made_up_run(1.3)), saved("new.json", without_times(made_up_run(), ""))
    assert main(["bench", "--load", new, "--compare", old]) == 1
    assert "grey (no reason given)" in capsys.readouterr().err


def test_a_case_left_out_for_the_cap_is_told_only(saved, capsys):
    note = "not run: about 99 s a run going by 640 x 480 x 64; --cap is 60 s"
    old, new = saved("old.json", made_up_run()), saved("new.json", without_times(made_up_run(), note))
    assert main(["bench", "--load", new, "--compare", old]) == 0
    assert f"left out: grey on opencl:one, 1280 x 960 x 128: {note}" in capsys.readouterr().out


def test_nothing_in_common():
    with pytest.raises(InputError, match="no case in common"):
        compare(made_up_run(devices=("opencl:one",)), made_up_run(devices=("warp:cpu",)))


@pytest.mark.parametrize(("slowdown", "status"), [(1.0, 0), (1.1, 0), (1.3, 1)])
def test_the_exit_status_of_a_comparison(saved, capsys, slowdown, status):
    old, new = saved("old.json", made_up_run()), saved("new.json", made_up_run(slowdown))
    assert main(["bench", "--load", new, "--compare", old]) == status
    said = capsys.readouterr()
    assert "12 cases compared" in said.out
    if status:
        assert said.err.count("\n") == 1
        assert "12 of 12 cases are over 1.15 times slower" in said.err and "ncc_wta, grey, match fast" in said.err
    assert main(["bench", "--load", new, "--compare", old, "--limit", "1.5"]) == 0


def test_a_run_from_the_command_line(tmp_path, capsys):
    kept = tmp_path / "kept.json"
    quick = ["--size", "96,64,16", "--window", "7", "--backend", "warp:cpu", "--only", "triangulate", "median"]
    assert main(["bench", *quick, "--seconds", "0.001", "--json", str(kept)]) == 0
    out = capsys.readouterr().out
    assert "96 x 64 x 16, window 7" in out and "medianBlur" in out
    assert [r.name for r in BenchRun.load(kept).rows] == ["median", "triangulate"]


DAMAGED = {
    "no rows": lambda held: held.update(rows=[]),
    "TypeError": lambda held: held["rows"][0].update(surprise=1),
    "KeyError": lambda held: held.pop("machine"),
    "a row of size": lambda held: held["rows"][0].update(width=0),
    "times": lambda held: held["rows"][0]["wall"].update(median=-1.0),
    "AttributeError": lambda held: held.update(rows=[1]),
    "rows: name 7": lambda held: held["rows"][0].update(name=7),
    "rows: device ['x']": lambda held: held["rows"][0].update(device=["x"]),
    "kind 'abacus'": lambda held: held["rows"][0].update(kind="abacus"),
    "none of its devices": lambda held: held["rows"][2].update(device="opencl:gone"),
    "bytes_moved 'many'": lambda held: held["rows"][2].update(bytes_moved="many"),
    "bytes_moved -1": lambda held: held["rows"][2].update(bytes_moved=-1),
    "operations '9'": lambda held: held["rows"][2].update(operations="9"),
    "transfer True": lambda held: held["rows"][2].update(transfer=True),
    "window 11.0": lambda held: held["rows"][2].update(window=11.0),
    "wall median '1'": lambda held: held["rows"][0]["wall"].update(median="1"),
    "wall highest inf": lambda held: held["rows"][0]["wall"].update(highest=float("inf")),
    "wall repeats 2.5": lambda held: held["rows"][0]["wall"].update(repeats=2.5),
    "copy_bytes_s of opencl:one 0": lambda held: held["devices"][0].update(copy_bytes_s=0),
    "copy_bytes_s of opencl:one '9'": lambda held: held["devices"][0].update(copy_bytes_s="9"),
    "operations_s of opencl:one nan": lambda held: held["devices"][0].update(operations_s=float("nan")),
    "devices: driver None": lambda held: held["devices"][0].update(driver=None),
    "KeyError: 'processor'": lambda held: held["machine"].pop("processor"),
    "KeyError: 'versions'": lambda held: held["machine"].pop("versions"),
    "versions ['2.0']": lambda held: held["machine"].update(versions=["2.0"]),
    "cores 'two'": lambda held: held["machine"].update(cores="two"),
    "memory_bytes 'all'": lambda held: held["machine"].update(memory_bytes="all"),
    "load_average 1000": lambda held: held["machine"].update(load_average=10**400),
    "KeyError: 'seconds'": lambda held: held["method"].pop("seconds"),
    "method repeats None": lambda held: held["method"].update(repeats=None),
    "peers [1]": lambda held: held.update(peers=[1]),
    "peers: StereoBM 3": lambda held: held["peers"].update(StereoBM=3),
    "run: started 9": lambda held: held.update(started=9),
    "took 'long'": lambda held: held.update(took="long"),
    "version 99": lambda held: held.update(version=99),
    "no run of the benchmark": lambda held: held.update(format="stereo-gpu rig"),
}


@pytest.mark.parametrize("says", DAMAGED)
def test_a_damaged_file(saved, tmp_path, capsys, says):
    good = saved("good.json", made_up_run())
    held = json.loads((tmp_path / "good.json").read_text("utf-8"))
    DAMAGED[says](held)
    bad = tmp_path / "bad.json"
    bad.write_text(json.dumps(held), "utf-8")
    assert main(["bench", "--load", good, "--compare", str(bad)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error and "bad.json" in error


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--compare", "missing.json"], "cannot read missing.json"),
        (["--compare", "text.json"], "text.json is not JSON"),
        (["--compare", "list.json"], "list.json is JSON, but no run"),
        (["--compare", "."], "cannot read ."),
        (["--load", "missing.json"], "cannot read missing.json"),
        (["--limit", "1"], "limit 1"),
        (["--only", "abacus"], "'abacus' cannot be timed"),
        (["--seconds", "-1"], "-1 seconds"),
        (["--json", "no/folder.json"], "no folder no"),
        (["--plot", "text.json"], "is a file"),
        (["--size", "64,64,16", "--size", "64,64"], "3 numbers"),
    ],
)
def test_wrong_input_is_one_line(tmp_path, monkeypatch, capsys, arguments, says):
    if "--plot" in arguments:
        need_matplotlib()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.json").write_text("GDE/s", "utf-8")
    (tmp_path / "list.json").write_text("[1]", "utf-8")
    assert main(["bench", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and says in error
