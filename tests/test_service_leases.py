from collections import Counter

import pytest
from stores import Clock, new_id, open_store, put, rig_of

from stereo_gpu.service.records import Kind, RigRecord, State
from stereo_gpu.service.store import Ending


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def store(tmp_path, clock):
    store = open_store(tmp_path, "ann", "bob", "cat", clock=clock)
    yield store
    assert store.check() == []
    store.close()


def done(lease, **given):
    return Ending(id=lease.job.id, number=lease.number, state=State.DONE, **given)


def clients_of(leases):
    return [lease.job.client for lease in leases]


def test_clients_take_turns_and_each_is_served_in_order(store):
    ann, bob, cat = put(store, "ann", 6), put(store, "bob", 2), put(store, "cat", 1)
    leases = store.lease("o", 9, 30)
    assert clients_of(leases) == ["ann", "bob", "cat", "ann", "bob", "ann", "ann", "ann", "ann"]
    ids = [lease.job.id for lease in leases]
    assert [id for id in ids if id in ann] == ann and [id for id in ids if id in bob] == bob and cat[0] in ids


def test_whoever_has_the_fewest_running_comes_first(store):
    put(store, "ann", 9)
    running = store.lease("o", 3, 30)
    put(store, "bob", 9)
    assert clients_of(store.lease("o", 3, 30)) == ["bob"] * 3
    # Now three each: by turns, the one first who was served longest ago.
    assert clients_of(store.lease("o", 4, 30)) == ["ann", "bob", "ann", "bob"]
    store.finish([done(lease) for lease in running])
    assert clients_of(store.lease("o", 3, 30)) == ["ann"] * 3


def test_turns_hold_where_nothing_runs_at_the_same_time(store):
    put(store, "ann", 50)
    put(store, "bob", 5)
    put(store, "cat", 5)
    served = []
    for _ in range(15):
        (lease,) = store.lease("o", 1, 30)
        served.append(lease.job.client)
        store.finish([done(lease)])
    assert Counter(served) == {"ann": 5, "bob": 5, "cat": 5}
    assert all(len(set(served[n : n + 3])) == 3 for n in range(0, 15, 3))


def test_a_client_that_floods_delays_another_by_no_more_than_a_turn(store):
    put(store, "ann", 500)
    store.begin(store.lease("o", 4, 30))
    (late,) = put(store, "bob")
    assert store.places([store.any_job(late)]) == {late: 0}
    assert store.lease("o", 2, 30)[0].job.id == late


def test_a_lease_is_told_with_its_try_and_time(store, clock):
    (job,) = put(store)
    clock.now += 5
    (lease,) = store.lease("o", 3, 30)
    assert (lease.job.id, lease.number, lease.until) == (job, 1, 1035.0)
    assert store.lease("o", 3, 30) == []


def test_a_leased_job_waits_until_a_worker_has_it(store, clock):
    begun, ahead = put(store, count=2)
    leases = store.lease("o", 2, 30)
    clock.now += 5
    for _ in range(2):  # once more changes nothing
        store.begin(leases[:1])
        clock.now += 1
    kept = [store.any_job(job) for job in (begun, ahead)]
    assert [(job.state, job.tries, job.started) for job in kept] == [
        (State.RUNNING, 1, 1005.0),
        (State.QUEUED, 0, None),
    ]
    assert [job.id for job in store.jobs("ann", state=State.QUEUED)] == [ahead]
    assert store.counts()[State.QUEUED] == store.counts()[State.RUNNING] == 1
    assert store.leased() == {begun, ahead}
    # It is cancelled at once, and then is nobody's to begin, to end or to give back.
    assert store.ask_cancel("ann", ahead).state is State.CANCELLED
    store.begin(leases)
    assert store.beat("o", {ahead: (None, 0.0)}, 30) == {ahead}
    assert store.finish([done(leases[1])]) == set() and store.give_back("o", [ahead], charge=True) == []
    assert (store.any_job(ahead).state, store.any_job(ahead).tries) == (State.CANCELLED, 0)


def test_a_service_that_dies_charges_only_what_had_begun(store):
    begun, ahead = put(store, count=2)
    for tries in (1, 2, 3):
        leases = store.lease(f"the {tries}th service", 2, 30)
        store.begin([lease for lease in leases if lease.job.id == begun])
        jobs = {job.id: job for job in store.reclaim(lambda owner: False, 3)}
        assert (jobs[begun].tries, jobs[ahead].tries, jobs[ahead].state) == (tries, 0, State.QUEUED)
    assert jobs[begun].state is State.FAILED and "the last of 3 tries" in jobs[begun].error


def test_a_heartbeat_keeps_a_lease_and_tells_how_far_it_is(store, clock):
    kept, left = put(store, count=2)
    store.begin(store.lease("o", 2, 30))
    for stage in ("read", "match", "mesh"):
        clock.now += 20
        assert store.beat("o", {kept: (stage, 0.25)}, 30) == set()
        reclaimed = store.reclaim(None, 3)
        assert [job.id for job in reclaimed] == ([left] if stage == "match" else [])
    job = store.any_job(kept)
    assert (job.state, job.stage, job.fraction) == (State.RUNNING, "mesh", 0.25)


def test_whoever_lost_a_lease_is_told_and_cannot_end_the_job(store, clock):
    (job,) = put(store)
    (old,) = store.lease("slow", 1, 30)
    store.begin([old])
    clock.now += 31
    (back,) = store.reclaim(None, 3)
    assert (back.state, back.tries, back.started) == (State.QUEUED, 1, 1000.0)
    assert store.beat("slow", {job: ("mesh", 0.9)}, 30) == {job}
    assert store.finish([done(old, summary={"by": "slow"})]) == set()
    (new,) = store.lease("quick", 1, 30)
    assert new.number == 2
    store.begin([old])
    assert store.any_job(job).state is State.QUEUED
    assert store.beat("slow", {job: ("mesh", 0.9)}, 30) == {job}
    assert store.give_back("slow", [job], charge=True) == []
    assert store.finish([done(old, summary={"by": "slow"})]) == set()
    assert store.finish([done(new, summary={"by": "quick"})]) == {job}
    assert store.finish([done(new, summary={"by": "again"})]) == set()
    assert store.any_job(job).summary == {"by": "quick"}
    assert store.reclaim(None, 3) == []


def test_after_so_many_lost_tries_a_job_has_failed_with_the_reason(store, clock):
    (job,) = put(store)
    for number in (1, 2, 3):
        (lease,) = store.lease("o", 1, 30)
        assert (lease.number, lease.job.tries) == (number, number - 1)
        store.begin([lease])
        store.beat("o", {job: ("match", 0.5)}, 30)
        clock.now += 31
        (changed,) = store.reclaim(None, 3)
    assert (changed.state, changed.ended) == (State.FAILED, clock.now)
    assert "during match in the last of 3 tries" in changed.error and "\n" not in changed.error
    assert store.lease("o", 1, 30) == []


def test_owners_that_are_gone_lose_their_leases_at_once(store):
    mine, theirs = put(store, count=2)
    store.lease("this", 1, 30)
    store.lease("dead", 1, 30)
    asked = []
    assert [job.id for job in store.reclaim(lambda owner: asked.append(owner) or owner == "this", 3)] == [theirs]
    assert sorted(asked) == ["dead", "this"] and store.leased() == {mine}


def test_what_is_given_back_keeps_its_place_and_the_try_counts_if_charged(store):
    for begun in (False, True):
        first, second, last = put(store, count=3)
        leases = store.lease("o", 2, 30)
        store.begin(leases if begun else [])
        assert [job.tries for job in store.give_back("o", [first], charge=False)] == [0]
        assert [job.tries for job in store.give_back("o", [second, new_id()], charge=True)] == [1]
        leases = store.lease("o", 9, 30)
        assert [lease.job.id for lease in leases] == [first, second, last]
        assert [(lease.number, lease.job.tries) for lease in leases] == [(2, 0), (2, 1), (1, 0)]
        store.finish([done(lease) for lease in leases])


def test_what_nobody_wants_any_more_does_not_go_back_into_the_queue(store, clock):
    back, lost = put(store, count=2)
    store.begin(store.lease("o", 2, 30))
    for job in (back, lost):
        store.ask_cancel("ann", job)
    assert [job.state for job in store.give_back("o", [back], charge=True)] == [State.CANCELLED]
    clock.now += 31
    assert [(job.id, job.state, job.error) for job in store.reclaim(None, 1)] == [(lost, State.CANCELLED, None)]


def test_an_ending_is_kept_whole(store, clock):
    (job,) = put(store, bytes=10)
    (lease,) = store.lease("o", 1, 30)
    store.begin([lease])
    clock.now += 2
    given = {"warnings": ("doubtful",), "seconds": {"match": 0.5, "total": 1.5}, "summary": {"triangles": 7}}
    assert store.finish([done(lease, bytes=500, **given)]) == {job}
    kept = store.any_job(job)
    assert {name: getattr(kept, name) for name in given} == given
    assert (kept.state, kept.ended, kept.bytes, kept.fraction, kept.error) == (State.DONE, 1002.0, 500, 1.0, None)


def test_a_failure_names_its_stage_and_reason(store):
    said, silent = put(store, count=2)
    leases = store.lease("o", 2, 30)
    store.beat("o", {said: ("match", 0.4), silent: ("match", 0.4)}, 30)
    failed = {"state": State.FAILED, "error": "no \udcff surface"}
    stages = ("mesh", None)
    store.finish(
        [
            Ending(id=lease.job.id, number=lease.number, stage=stage, **failed)
            for lease, stage in zip(leases, stages, strict=True)
        ]
    )
    assert [store.any_job(job).stage for job in (said, silent)] == ["mesh", "match"]
    assert store.any_job(said).error == "no ? surface"


def test_a_calibration_ends_with_its_rig_or_not_at_all(store):
    (job,) = put(store, kind=Kind.CALIBRATION, rig=None)
    (lease,) = store.lease("o", 1, 30)
    rig = RigRecord(id=job, client="ann", name="new", created=1.0, calibration=job)
    wrong = Ending(id=job, number=lease.number + 1, state=State.DONE, rig=rig)
    assert store.finish([wrong]) == set() and store.rig("ann", job) is None
    assert store.finish([done(lease, rig=rig)]) == {job}
    assert store.any_job(job).rig == job and store.rig("ann", job).calibration == job


def test_a_rig_is_right_with_the_first_pair_that_says_so(store):
    one, other = put(store, count=2)
    for job, right in ((one, False), (other, True)):
        (lease,) = store.lease("o", 1, 30)
        assert store.finish([done(lease, rig_is_right=right)]) == {job}
        assert store.rig("ann", rig_of("ann")).checked == right
    assert not store.rig("bob", rig_of("bob")).checked


@pytest.mark.parametrize(
    ("state", "error"), [(State.RUNNING, None), (State.FAILED, None), (State.FAILED, ""), (State.DONE, "why")]
)
def test_an_ending_that_is_none_is_refused(state, error):
    with pytest.raises(ValueError, match="cannot end"):
        Ending(id=new_id(), number=1, state=state, error=error)


def test_a_clock_that_steps_back_breaks_no_rule(store, clock):
    ran, waited = put(store, count=2)
    clock.now -= 500
    (lease,) = store.lease("o", 1, 30)
    store.begin([lease])
    clock.now -= 100
    store.finish([done(lease)])
    store.ask_cancel("ann", waited)
    for job in (ran, waited):
        assert store.any_job(job).ended >= store.any_job(job).created


def test_old_jobs_are_found_by_their_end_and_room(store, clock):
    ids = put(store, count=4, bytes=10)
    for lease in store.lease("o", 3, 30):
        clock.now += 10
        store.finish([done(lease, bytes=100)])
    assert [job.id for job in store.ended_before(1025.0)] == ids[:2]
    assert [job.id for job in store.oldest_ended(limit=1)] == ids[:1]
    assert store.ended_bytes() == 300
    assert store.known() >= set(ids)
