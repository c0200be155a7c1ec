"""`stereo-gpu batch`: a folder a pair, whole or not at all; failures alone; what is done is not done again."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stereo_gpu.batch import reconstruct_batch
from stereo_gpu.batching.pair_list import list_pairs
from stereo_gpu.cli import main
from stereo_gpu.config import MeshOptions
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image, write_png
from stereo_gpu.rig import Rig

QUICK = ["--profile", "fast", "--disparities", "16,44", "--faces", "2000", "--unwrap", "view"]
MODEL = ["model.glb", "result.json"]


@pytest.fixture
def pairs(raw_folder, tmp_path):
    """Six pairs that differ; the third is cut off."""
    folder = tmp_path / "pairs"
    folder.mkdir()
    for side in ("left", "right"):
        picture = read_image(raw_folder / f"{side}.png")
        for number in range(1, 7):
            write_png(folder / f"{side}{number}.png", picture - (picture > 128) * picture.dtype.type(number))
    shutil.copy(raw_folder / "rig.json", folder / "rig.json")
    damaged = folder / "right3.png"
    damaged.write_bytes(damaged.read_bytes()[:2000])
    return folder


def batch(pairs, out, *more):
    return main(["batch", str(pairs), "--rig", str(pairs / "rig.json"), "--out", str(out), *QUICK, *more])


def tree(folder):
    return sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())


def test_a_broken_pair_fails_alone_and_what_is_done_is_skipped(pairs, tmp_path, capfd):
    out = tmp_path / "new" / "out"
    assert batch(pairs, out) == 1
    said = capfd.readouterr()
    good = [f"{number}/{name}" for number in (1, 2, 4, 5, 6) for name in MODEL]
    assert tree(out) == sorted([*good, "failed.jsonl"])
    (failed,) = (json.loads(line) for line in (out / "failed.jsonl").read_text().splitlines())
    assert failed["name"] == "3" and "right3.png is cut off" in failed["error"]
    (listed,) = list_pairs(out / "failed.jsonl")
    assert (listed.name, listed.left, listed.mask) == ("3", pairs / "left3.png", None)
    assert "5 made" in said.out and "1 failed, of 6 pairs" in said.out and "pairs/" in said.out
    assert "6 of 6 pairs" in said.err and "1 of 6 pairs failed" in said.err
    record = json.loads((out / "4" / "result.json").read_text())
    assert record["options"]["check"] == "rows" and record["counts"]["triangles"] > 100
    assert json.loads((out / "1" / "result.json").read_text())["options"]["check"] == "full"

    # One mended, one changed, and started again: these two are done, and nothing is left to be listed.
    before = {file: (out / file).stat().st_mtime_ns for file in good}
    shutil.copy(pairs / "right4.png", pairs / "right3.png")
    shutil.copy(pairs / "left4.png", pairs / "left2.png")
    assert batch(pairs, out, "--workers", "1") == 0
    assert "2 made" in (said := capfd.readouterr().out) and "4 skipped" in said
    assert tree(out) == sorted([*good, "3/model.glb", "3/result.json"])
    assert [file for file in good if (out / file).stat().st_mtime_ns != before[file]] == [f"2/{name}" for name in MODEL]

    # Another option and --again do it once more.
    one = pairs / "one.csv"
    one.write_text("left1.png,right1.png\n")
    for more in (["--texture-format", "jpeg", "--check", "never"], ["--again"]):
        assert main(["batch", str(one), "--rig", str(pairs / "rig.json"), "--out", str(out), *QUICK, *more]) == 0
        assert "1 made" in (said := capfd.readouterr().out) and "skipped" not in said
    assert tree(out) == sorted([*good, "3/model.glb", "3/result.json"])


def test_outcomes_come_in_order_and_all_files_can_be_had(pairs, tmp_path):
    listed, rig = list_pairs(pairs)[:2], Rig.load(pairs / "rig.json")
    options = {"profile": "fast", "disparities": (16, 44), "mesh": MeshOptions(faces=2000, unwrap="view")}
    done = list(reconstruct_batch(listed, rig, tmp_path / "out", files="all", workers=1, **options))
    assert [each.pair.name for each in done] == ["1", "2"] and all(each.error is None for each in done)
    assert all(each.triangles > 100 and not each.skipped for each in done)
    expected = {"model.glb", "model.obj", "cloud.ply", "surface.vtp", "report.html", "result.json", "disparity.pfm"}
    assert expected <= {file.name for file in (tmp_path / "out" / "2").iterdir()}
    with pytest.raises(InputError, match="give first, every or never, and model or all"):
        reconstruct_batch(listed, rig, tmp_path / "out", files="some", **options)


def test_a_second_batch_is_kept_out_of_the_folder(pairs, tmp_path):
    listed, rig = list_pairs(pairs), Rig.load(pairs / "rig.json")
    options = {"profile": "fast", "disparities": (16, 44), "mesh": MeshOptions(faces=2000, unwrap="view")}
    first = reconstruct_batch(listed, rig, tmp_path / "out", workers=1, check="never", **options)
    next(first)
    with pytest.raises(InputError, match="another batch writes to"):
        next(reconstruct_batch(listed, rig, tmp_path / "out", workers=1, **options))
    first.close()
    assert not list((tmp_path / "out").glob(".*"))


def test_another_try_of_a_pair_may_be_quicker(pairs, tmp_path, monkeypatch):
    """As where a node that was thought lost goes on: its result is as good."""
    rename = Path.rename

    def be_late(staging, target):
        shutil.copytree(staging, target)
        return rename(staging, target)

    monkeypatch.setattr(Path, "rename", be_late)
    rig, out, one = Rig.load(pairs / "rig.json"), tmp_path / "out", list_pairs(pairs)[:1]
    options = {"profile": "fast", "disparities": (16, 44), "mesh": MeshOptions(faces=2000, unwrap="view")}
    (outcome,) = reconstruct_batch(one, rig, out, engine="inline", **options)
    assert outcome.error is None and tree(out) == [f"1/{name}" for name in MODEL]
    assert not list(out.glob(".*"))


def children(pid):
    """Processes of the group that a worker leads; each has its own."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_batch_leaves_whole_files_and_no_process(pairs, tmp_path, how):
    out = tmp_path / "out"
    shutil.copy(pairs / "right2.png", pairs / "right3.png")
    command = [
        sys.executable,
        "-c",
        "import sys; from stereo_gpu.cli import main; sys.exit(main())",
        "batch",
        str(pairs),
    ]
    command += ["--rig", str(pairs / "rig.json"), "--out", str(out), *QUICK, "--workers", "1", "--check", "never"]
    batch = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not (out.is_dir() and [entry for entry in out.iterdir() if not entry.name.startswith(".")]):
        assert batch.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    workers = children(batch.pid)
    batch.send_signal(how)
    time.sleep(0.05)
    batch.send_signal(how)  # impatient people press it twice
    said, told = batch.communicate(timeout=20)
    # The last pairs may have been done by then.
    assert batch.returncode in (0, 130) and "Traceback" not in told
    assert batch.returncode == 0 or ("goes on from here" in said and "interrupted" in told)
    assert workers and not any(Path(f"/proc/{worker}").exists() for worker in workers)
    names = {str(file.relative_to(out)) for file in out.rglob("*") if file.is_file()}
    assert names == {f"{folder.name}/{name}" for folder in out.iterdir() for name in MODEL}


def test_a_batch_whose_process_is_killed_goes_on(pairs, tmp_path):
    out = tmp_path / "out"
    left = out / ".4.0123456789ab.part"  # what a run leaves that was itself killed
    left.mkdir(parents=True)
    listed, rig = list_pairs(pairs), Rig.load(pairs / "rig.json")
    options = {"profile": "fast", "disparities": (16, 44), "mesh": MeshOptions(faces=2000, unwrap="view")}
    done = reconstruct_batch(listed, rig, out, workers=1, check="never", **options)
    first = [next(done), next(done)]
    assert not left.exists()
    for worker in children(os.getpid()):
        if b"engines/worker.py" in Path(f"/proc/{worker}/cmdline").read_bytes():
            os.kill(worker, signal.SIGKILL)
    rest = [*first, *done]
    failed = [each.pair.name for each in rest if each.error is not None]
    assert "3" in failed and len(failed) <= 2
    assert [each.pair.name for each in rest] == ["1", "2", "3", "4", "5", "6"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere", "--rig", "rig.json", "--out", "o"], "nowhere cannot be read"),
        ([".", "--rig", "none.json", "--out", "o"], "none.json"),
        ([".", "--rig", "rig.json", "--out", "rig.json"], "rig.json is a file"),
        ([".", "--rig", "rig.json", "--out", "o", "--workers", "0"], "workers = 0"),
        ([".", "--rig", "rig.json", "--out", "o", "--limit", "-1"], "a limit of -1"),
        ([".", "--rig", "rig.json", "--out", "o", "--profile", "slow"], "slow"),
        ([".", "--rig", "rig.json", "--out", "o", "--check", "some"], "invalid choice: 'some'"),
    ],
)
def test_wrong_input_is_refused_in_one_line(pairs, monkeypatch, capfd, arguments, message):
    monkeypatch.chdir(pairs)
    assert main(["batch", *arguments]) == 2
    said = capfd.readouterr()
    assert message in said.err and said.err.count("\n") == 1 and not (pairs / "o").exists()


def test_a_wrong_limit_is_refused_before_an_engine_is_opened(pairs, tmp_path, monkeypatch):
    """Which may be a whole cluster, that nobody would end."""
    monkeypatch.setattr("stereo_gpu.batch.open_executor", None)
    with pytest.raises(InputError, match="a limit of 0"):
        reconstruct_batch(list_pairs(pairs), Rig.load(pairs / "rig.json"), tmp_path / "out", engine="ray", limit_s=0)
