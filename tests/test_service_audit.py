import pytest
from stores import open_store, put, rig_of

from stereo_gpu.service.data.audit import audit
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.records import State
from stereo_gpu.service.store import Ending


@pytest.fixture
def folders(tmp_path):
    folders = Folders(tmp_path / "data")
    with folders.own():
        yield folders


@pytest.fixture
def store(folders):
    store = open_store(folders.root, "ann")
    folders.rig(rig_of("ann")).parent.mkdir()
    folders.rig(rig_of("ann")).write_text("{}")
    yield store
    store.close()


def test_what_a_backup_lacks_is_named(store, folders):
    waits, done = put(store, count=2)
    for id in (done, waits):
        upload = folders.new_upload()
        (upload / "left.png").write_bytes(b"123")
        folders.accept(upload, id)
    for lease in store.lease("o", 2, 30):
        if lease.job.id == done:
            folders.attempt(done, lease.number).mkdir()
            (folders.attempt(done, lease.number) / "model.glb").write_bytes(b"model")
            folders.seal(folders.attempt(done, lease.number))
            folders.publish(done, lease.number)
            store.finish([Ending(id=done, number=lease.number, state=State.DONE)])
        else:
            store.give_back("o", [waits], charge=False)
    assert audit(store, folders) == []

    (folders.inputs(waits) / "left.png").write_bytes(b"12")
    (folders.result(done) / "model.glb").unlink()
    folders.rig(rig_of("ann")).unlink()
    assert audit(store, folders) == [
        f"job {waits} is queued: {folders.inputs(waits) / 'left.png'} is missing or cut off",
        f"job {done} is done: {folders.result(done)} is missing or not whole",
        f"rig {rig_of('ann')}: {folders.rig(rig_of('ann'))} is missing",
    ]
    store.ask_cancel("ann", waits)
    for id in (waits, done):
        store.delete("ann", id)
    store.delete_rig("ann", rig_of("ann"))
    assert audit(store, folders) == []
