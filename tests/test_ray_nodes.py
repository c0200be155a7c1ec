"""Clusters that are there already: a wrong address, and two nodes of which one is lost amid a batch."""

import importlib.util
import re
import tempfile
import threading
import time
from pathlib import Path

import pytest
from conftest import missing

from stereo_gpu.batch import reconstruct_batch, refuse_unshared
from stereo_gpu.batching.pair_list import ListedPair
from stereo_gpu.cli import main
from stereo_gpu.config import MeshOptions
from stereo_gpu.errors import InputError
from stereo_gpu.rig import Rig

SOON_S = 60.0
PAIRS = 12


@pytest.fixture
def ray():
    if importlib.util.find_spec("ray") is None:
        missing("ray", 'it is not installed: pip install "stereo-gpu[ray]"')


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("127.0.0.1:1", "no Ray cluster answers at 127.0.0.1:1"),
        ("nonsense", "HOST:PORT"),
        ("ray://127.0.0.1:10001", "HOST:PORT"),
        ("127.0.0.1:99999999", "HOST:PORT"),
    ],
)
def test_a_wrong_address_is_refused_at_once(ray, address, said, raw_folder, tmp_path, capsys):
    arguments = ["batch", raw_folder, "--rig", raw_folder / "rig.json", "--out", tmp_path / "out"]
    status = main([*map(str, arguments), "--engine", "ray", "--address", address])
    error = capsys.readouterr().err
    assert status == 2 and said in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_node_that_does_not_see_the_folder_is_refused(tmp_path):
    refuse_unshared(tmp_path, rig=None)
    with pytest.raises(InputError, match="put it on storage that all nodes share"):
        refuse_unshared(tmp_path / "mark", rig=None)


@pytest.fixture
def two_nodes(ray, monkeypatch):
    """A cluster whose head does no jobs, and its two nodes of one core each."""
    from ray.cluster_utils import Cluster

    with tempfile.TemporaryDirectory(prefix="nodes", dir="/tmp") as folder:  # the names of sockets are long
        monkeypatch.setenv("RAY_TMPDIR", folder)
        temporary = Path(folder) / "ray"
        temporary.mkdir()
        store = 80 << 20
        cluster = Cluster(
            initialize_head=True,
            head_node_args={
                "num_cpus": 0,
                "include_dashboard": False,
                "temp_dir": str(temporary),
                "object_store_memory": store,
            },
        )
        try:
            yield cluster, [cluster.add_node(num_cpus=1, object_store_memory=store) for _ in range(2)]
        finally:
            cluster.shutdown()


def processes(node, pattern):
    """The processes of a node whose command line fits."""
    import psutil

    raylet = psutil.Process(node.all_processes["raylet"][0].process.pid)
    found = []
    for child in (raylet, *raylet.children(recursive=True)):
        try:
            if re.search(pattern, " ".join(child.cmdline())):
                found.append(child)
        except psutil.Error:
            continue
    return found


def test_a_worker_and_a_node_are_killed_and_nothing_is_lost(two_nodes, raw_folder, tmp_path):
    cluster, nodes = two_nodes
    rig = Rig.load(raw_folder / "rig.json")
    pairs = [
        ListedPair(name=f"{number:02d}", left=raw_folder / "left.png", right=raw_folder / "right.png")
        for number in range(PAIRS)
    ]
    options = {"profile": "fast", "disparities": (16, 48), "mesh": MeshOptions(faces=2000, unwrap="view")}
    out = tmp_path / "out"
    outcomes, threads = [], threading.active_count()
    batch = reconstruct_batch(pairs, rig, out, engine="ray", address=cluster.address, **options)
    for outcome in batch:
        outcomes.append(outcome)
        if len(outcomes) == 3:
            processes(nodes[1], "worker.py")[0].kill()
        if len(outcomes) == 6:
            doomed = processes(nodes[0], ".")
            for process in doomed:
                process.kill()
            cluster.remove_node(nodes[0], allow_graceful=False)
    assert [outcome.pair.name for outcome in outcomes] == [pair.name for pair in pairs]
    assert [outcome.error for outcome in outcomes] == [None] * PAIRS
    models = {(out / pair.name / "model.glb").read_bytes() for pair in pairs}
    assert len(models) == 1 and not (out / "failed.jsonl").exists()
    assert sorted(entry.name for entry in out.iterdir()) == [pair.name for pair in pairs]
    deadline = time.monotonic() + SOON_S
    while threading.active_count() > threads:
        assert time.monotonic() < deadline
        time.sleep(0.02)
