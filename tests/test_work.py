"""What a worker does with a job: results equal to the library's, and where a picture is bad one line without paths."""

import errno
import json
import shutil
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
from conftest import need_service

need_service()

import stereo_gpu as sg  # noqa: E402
from stereo_gpu.errors import BackendError, PictureError, WorkerError  # noqa: E402
from stereo_gpu.images import write_png  # noqa: E402
from stereo_gpu.scene_render import render_boards  # noqa: E402
from stereo_gpu.service.data.folders import Folders  # noqa: E402
from stereo_gpu.service.dispatch.endings import end_well, find_outcome  # noqa: E402
from stereo_gpu.service.jobs import work  # noqa: E402
from stereo_gpu.service.jobs.order import STEPS, WorkOrder, stages_of  # noqa: E402
from stereo_gpu.service.records import Job, Kind, Lease, State  # noqa: E402

JOB, RIG = "a" * 32, "b" * 32
FAST = {"profile": "fast", "disparities": [22, 40]}
PAIR = ("left.png", "right.png")


@pytest.fixture
def folders(tmp_path, raw_folder):
    """A data folder with the scene's rig and pair."""
    folders = Folders(tmp_path / "data")
    with folders.own():
        folders.rig(RIG).parent.mkdir()
        shutil.copy(raw_folder / "rig.json", folders.rig(RIG))
        folders.inputs(JOB).mkdir(parents=True)
        for name in PAIR:
            shutil.copy(raw_folder / name, folders.inputs(JOB))
        yield folders


def order(options=FAST, *, inputs=PAIR, **given):
    default = {"job": JOB, "number": 1, "kind": Kind.RECONSTRUCTION, "rig": RIG, "check": "full"}
    return WorkOrder(options=options, inputs=inputs, **{**default, **given})


def do(folders, order, tell=lambda word: None):
    return work.do_job(order, data=folders.root, backend=None, tell=tell)


def test_a_result_is_the_librarys_to_the_byte(folders, raw_folder, tmp_path):
    said = []
    answer = do(folders, order({**FAST, "files": "all"}), said.append)
    rig = sg.Rig.load(raw_folder / "rig.json")
    result = sg.reconstruct(
        raw_folder / "left.png", raw_folder / "right.png", rig, profile="fast", disparities=(22, 40)
    )
    attempt = folders.attempt(JOB, 1)
    named = {path.name for path in result.save(tmp_path / "library")}
    assert {path.name for path in attempt.iterdir()} == {*named, "manifest.json"}
    for name in ("model.glb", "model.obj", "model.ply", "cloud.ply", "surface.vtp", "disparity.pfm", "disparity.png"):
        assert (attempt / name).read_bytes() == (tmp_path / "library" / name).read_bytes(), name
    assert said == list(stages_of(Kind.RECONSTRUCTION))  # without pictures of steps, nothing else is said
    outcome = answer["outcome"]
    assert outcome.checked and outcome.warnings == tuple(result.warnings)
    assert set(outcome.seconds) == set(result.seconds)
    assert outcome.summary["triangles"] == len(result.mesh.faces)
    near, far = outcome.summary["depth"]
    assert 0 < near < far and outcome.summary["unit"] == "mm"
    assert not folders.steps(JOB).exists()
    json.dumps(outcome.as_json(), allow_nan=False)


def test_the_outcome_lies_in_the_result(folders):
    answer = do(folders, order())
    assert {path.name for path in folders.attempt(JOB, 1).iterdir()} == {"model.glb", "result.json", "manifest.json"}
    job = Job(id=JOB, client="ann", kind=Kind.RECONSTRUCTION, created=1.0, rig=RIG)
    assert find_outcome(folders, job) is None
    ending = end_well(folders, Lease(job=job, number=1, until=9.0), answer["outcome"], 2.0)
    assert (ending.state, ending.seconds["total"], ending.rig) == (State.DONE, 2.0, None)
    assert find_outcome(folders, job) == answer["outcome"]
    (folders.result(JOB) / "model.glb").unlink()
    assert find_outcome(folders, job) is None


def test_pictures_of_the_steps(folders):
    said = []
    do(folders, order({**FAST, "steps": True}), said.append)
    assert [word for word in said if word.startswith("step:")] == [f"step:{name}" for name in STEPS]
    assert said.index("step:disparity") < said.index("triangulate") < said.index("step:textured")
    assert {path.name for path in folders.steps(JOB).iterdir()} == {f"{name}.jpg" for name in STEPS}
    for name in STEPS:
        picture = cv2.imread(str(folders.step(JOB, name)))
        assert max(picture.shape) <= 960 and picture.std() > 10, name


def test_no_picture_of_a_step_is_worth_a_model(folders, caplog):
    folders.steps(JOB).write_text("a file where the folder should be")
    assert do(folders, order({**FAST, "steps": True}))["outcome"].summary["triangles"] > 100
    assert "no picture of pair" in caplog.text


def test_a_fault_of_a_picture_loses_no_model(folders, caplog, monkeypatch):
    monkeypatch.setattr(
        "stereo_gpu.service.jobs.step_pictures.figures.colour_disparity", lambda values: values[0, 0, 0]
    )
    assert do(folders, order({**FAST, "steps": True}))["outcome"].summary["triangles"] > 100
    assert "no picture of disparity: too many indices" in caplog.text
    assert not folders.step(JOB, "disparity").exists() and folders.step(JOB, "textured").exists()


def test_large_pictures_with_16_bits_are_shown_as_bright_as_small_ones(folders, raw_folder):
    for name in PAIR:
        picture = sg.read_image(raw_folder / name)
        write_png(folders.inputs(JOB) / name, picture.astype(np.uint16) * 4)  # 10 bits of 16
    do(folders, order({**FAST, "steps": True}))
    assert cv2.imread(str(folders.step(JOB, "rectified"))).mean() > 60


def test_a_mask_and_a_tried_rig(folders):
    painted = np.zeros((240, 320), np.uint8)
    painted[60:180, 80:240] = 255
    write_png(folders.inputs(JOB) / "mask.png", painted)
    outcome = do(folders, order(inputs=(*PAIR, "mask.png"), check="rows"))["outcome"]
    record = json.loads((folders.attempt(JOB, 1) / "result.json").read_text())
    assert record["counts"]["wanted"] <= 120 * 160 and record["options"]["mask"]
    assert record["options"]["check"] == "rows" and not outcome.checked


def test_a_bad_picture_is_named_as_the_client_knows_it(folders, raw_folder):
    (folders.inputs(JOB) / "left.png").write_bytes((raw_folder / "left.png").read_bytes()[:5000])
    with pytest.raises(PictureError) as caught:
        do(folders, order())
    assert str(caught.value) == "left.png is cut off: copy it again or save it as PNG"
    assert not folders.attempt(JOB, 1).exists()


def test_what_a_try_before_has_left_is_no_part_of_the_result(folders):
    folders.attempt(JOB, 1).mkdir()
    (folders.attempt(JOB, 1) / "odd.bin").write_bytes(b"half")
    do(folders, order())
    assert not (folders.attempt(JOB, 1) / "odd.bin").exists()


def test_a_full_disk_is_not_the_jobs_fault(folders, monkeypatch):
    def full(stream):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("stereo_gpu.files.os.fsync", full)
    with pytest.raises(WorkerError, match="No space left on device") as caught:
        do(folders, order())
    assert str(folders.root) not in str(caught.value)


def test_a_worker_whose_device_does_nothing_more_ends(folders, monkeypatch):
    def broken(*args, **kwargs):
        raise BackendError("launch failed: an illegal address")

    monkeypatch.setattr("stereo_gpu.pipeline.match_in_tiles", broken)
    with pytest.raises(SystemExit, match="does not work any more"):
        do(folders, order())
    # It ends for what the device does, not for a job that is wrong: where the probe goes well, the error is told.
    calls = []

    def once(*args, **kwargs):
        calls.append(1)
        raise BackendError("launch failed once")

    monkeypatch.setattr("stereo_gpu.pipeline.match_in_tiles", once)
    monkeypatch.setattr(work, "prepare", lambda **kwargs: None)
    with pytest.raises(BackendError, match="launch failed once"):
        do(folders, order())
    assert calls


def test_a_worker_ends_where_the_storage_is_gone(folders):
    # Else it would say of every job that its pictures are missing, as fast as they come.
    folders.root.rename(folders.root.with_name("elsewhere"))
    with pytest.raises(SystemExit, match="is there no more"):
        do(folders, order())


def test_prepare_makes_a_device_ready(tmp_path, monkeypatch):
    ran = []
    reconstruct = work.reconstruct
    monkeypatch.setattr(work, "reconstruct", lambda *a, **k: ran.append(k["profile"]) or reconstruct(*a, **k))
    work.prepare(data=tmp_path, backend=None)
    assert ran == ["fast", "precise"]
    with pytest.raises(BackendError, match="unknown"):
        work.prepare(data=tmp_path, backend="abacus")


def test_a_calibration_makes_a_rig_and_what_tells_of_it(folders, small_scene):
    job = "c" * 32
    folders.inputs(job).mkdir(parents=True)
    names = []
    for number, pair in enumerate(render_boards(small_scene)[:8]):
        for side, picture in zip(("left", "right"), pair, strict=True):
            names.append(f"{side}{number:03d}.png")
            write_png(folders.inputs(job) / names[-1], picture)
    board, said = small_scene.board, []
    options = {"board": f"{board.columns}x{board.rows}", "square": board.square}
    given = order(options, inputs=tuple(names), job=job, kind=Kind.CALIBRATION, rig=None)
    outcome = do(folders, given, said.append)["outcome"]
    assert [word for word in said if ":" not in word] == list(stages_of(Kind.CALIBRATION))
    attempt = folders.attempt(job, 1)
    rig = sg.Rig.load(attempt / "rig.json")
    assert rig.baseline == pytest.approx(small_scene.rig.baseline, rel=0.005)
    told = json.loads((attempt / "calibration.json").read_text())
    assert (told["pairs"], len(told["views"])) == (8, 8)
    assert told["views"][0]["left"] == "left000.png" and 0 < told["views"][0]["left_px"] < 0.5
    assert told["arrows"]["left"].startswith("Arrows are drawn")
    assert told["advice"] == list(outcome.warnings) and 0 < told["coverage"]["left"] < 1
    for name in ("coverage-left", "coverage-right", "arrows-left", "arrows-right"):
        drawing = ET.parse(attempt / f"{name}.svg").getroot()
        assert drawing.tag == "{http://www.w3.org/2000/svg}svg" and drawing[0].tag.endswith("style")
    kept = Job(id=job, client="ann", kind=Kind.CALIBRATION, created=1.0, label="mine")
    for _ in range(2):  # again after a stop between the two
        ending = end_well(folders, Lease(job=kept, number=1, until=9.0), outcome, 1.0)
    assert (ending.rig.id, ending.rig.name, ending.rig.calibration) == (job, "mine", job)
    assert ending.rig.summary["baseline"] == rig.baseline and not ending.rig.checked
    assert sg.Rig.load(folders.rig(job)).baseline == rig.baseline
