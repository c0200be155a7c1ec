"""Many pairs at once: in order, with the results that each alone would have, and a broken one fails alone."""

import os
import threading
from pathlib import Path

import numpy as np
import pytest
import worker_tasks

import stereo_gpu as sg
from stereo_gpu.config import MeshOptions
from stereo_gpu.errors import BackendError, InputError, PictureError

QUICK = {"profile": "fast", "disparities": (16, 44), "mesh": MeshOptions(faces=2000, unwrap="view")}


@pytest.fixture(scope="module")
def files(raw_folder):
    return raw_folder / "left.png", raw_folder / "right.png"


def test_six_pairs_of_which_one_is_broken(files, small_scene, raw_folder):
    left, right = (sg.read_image(file) for file in files)
    masked = np.ones(left.shape[:2], np.uint8)
    masked[:120] = 0
    broken = raw_folder / "broken.png"
    broken.write_bytes(files[1].read_bytes()[:5000])
    pairs = [files, (left, right), (files[0], broken), (left, right, masked), (left, left), files]
    found = list(sg.reconstruct_many(iter(pairs), small_scene.rig, workers=2, **QUICK))
    assert [outcome.index for outcome in found] == [0, 1, 2, 3, 4, 5]
    assert isinstance(found[2].error, PictureError) and "broken.png" in str(found[2].error)
    assert isinstance(found[4].error, InputError) and "one and the same" in str(found[4].error)
    assert found[2].result is None and found[4].result is None
    well = [found[index].result for index in (0, 1, 5)]
    alone = sg.reconstruct(*files, small_scene.rig, **QUICK)
    for result in well:
        assert np.array_equal(result.disparity.values, alone.disparity.values, equal_nan=True)
        assert np.array_equal(result.mesh.vertices, alone.mesh.vertices)
        assert np.array_equal(result.mesh.texture, alone.mesh.texture)
    assert not np.isfinite(found[3].result.disparity.values[:110]).any()
    # The first pair is checked in full, the others by their rows.
    assert "features" in well[0].checked.says and "places of the map" in well[1].checked.says
    assert well[0].options["check"] == "full" and well[2].options["check"] == "rows"


def test_what_is_wrong_is_refused_before_any_process_starts(files, small_scene):
    rig = small_scene.rig
    for options, error, message in (
        ({"check": "sometimes"}, InputError, "check = 'sometimes': give first, every or never"),
        ({"profile": "slow"}, InputError, "slow"),
        ({"workers": 0}, InputError, "workers = 0"),
        ({"backend": "abacus"}, BackendError, "abacus"),
        ({"then": lambda index, result: index}, InputError, "put it into a module"),
        ({"mesh": MeshOptions(faces=-1)}, InputError, "faces = -1"),
    ):
        with pytest.raises(error, match=message):
            sg.reconstruct_many([files], rig, **options)
    with pytest.raises(InputError, match=r"pair 0 is 'one\.png'"):
        list(sg.reconstruct_many(["one.png"], rig, **QUICK))


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads its memory from /proc")
def test_memory_does_not_grow_with_the_pairs(files, small_scene):
    options = {**QUICK, "check": "never", "then": worker_tasks.memory}
    held = [outcome.result for outcome in sg.reconstruct_many([files] * 30, small_scene.rig, workers=1, **options)]
    # One pair's arrays are about 4 MB: a leak of one of them in three pairs would show.
    assert max(held[24:]) < max(held[6:12]) + 16e6


def test_leaving_early_ends_the_processes(files, small_scene):
    endless, before = iter(lambda: files, None), set(threading.enumerate())
    options = {**QUICK, "check": "never", "then": worker_tasks.triangles}
    found = sg.reconstruct_many(endless, small_scene.rig, workers=2, **options)
    taken = [next(found) for _ in range(3)]
    found.close()
    # What `then` returned has taken the place of the result.
    assert [outcome.result[0] for outcome in taken] == [0, 1, 2]
    assert all(outcome.result[1] > 100 and outcome.result[2] != os.getpid() for outcome in taken)
    assert not any(Path(f"/proc/{outcome.result[2]}").exists() for outcome in taken)
    assert not [new for new in set(threading.enumerate()) - before if new.name.startswith("stereo-gpu")]
