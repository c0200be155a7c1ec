"""How far jobs are, and who hears of it."""

import threading

from stereo_gpu.service.jobs.order import stages_of
from stereo_gpu.service.live import Live, Progress
from stereo_gpu.service.records import Kind

JOB, OTHER = "1" * 32, "2" * 32


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def test_stages_seconds_and_steps_of_a_job():
    clock = Clock()
    live = Live(clock)
    assert live.progress(JOB) is None
    live.begin(JOB, Kind.RECONSTRUCTION)
    assert live.progress(JOB) == Progress()
    live.took(JOB, 3)
    for stage, now in (("read", 0.0), ("rig", 0.5), ("rectify", 1.25)):
        clock.now = now
        live.tell(JOB, stage)
    live.tell(JOB, "step:rectified")
    live.tell(JOB, "step:rectified")
    told = live.progress(JOB)
    stages = stages_of(Kind.RECONSTRUCTION)
    assert (told.stage, told.worker, told.steps) == ("rectify", 3, ("rectified",))
    assert told.seconds == {"read": 0.5, "rig": 0.75}
    assert told.fraction == stages.index("rectify") / len(stages)
    assert live.stages() == {JOB: ("rectify", told.fraction)}
    live.end(JOB)
    assert live.progress(JOB) is None and live.stages() == {}


def test_the_fraction_never_goes_back_and_counts_parts_of_a_stage():
    live = Live()
    live.begin(JOB, Kind.RECONSTRUCTION)
    live.tell(JOB, "match")
    reached = live.progress(JOB).fraction
    live.tell(JOB, "check")  # by rows it comes after the match
    assert live.progress(JOB).fraction == reached and live.progress(JOB).stage == "check"
    live.begin(OTHER, Kind.CALIBRATION)
    live.tell(OTHER, "find:0.500")
    assert live.progress(OTHER).stage == "find"
    assert live.progress(OTHER).fraction == 0.5 / len(stages_of(Kind.CALIBRATION))


def test_words_of_a_job_that_is_over_are_not_heard():
    live = Live()
    live.tell(JOB, "read")
    live.took(JOB, 0)
    live.end(JOB)
    assert live.progress(JOB) is None


def test_listeners_hear_of_their_job_alone_until_they_go():
    live, heard = Live(), []
    mine, theirs = (lambda: heard.append("mine")), (lambda: heard.append("theirs"))
    live.subscribe(JOB, mine)
    live.subscribe(OTHER, theirs)
    live.begin(JOB, Kind.RECONSTRUCTION)
    live.took(JOB, 0)
    live.queue_moved()  # which is nothing to a job that a worker has
    assert heard == ["mine", "mine", "theirs"]
    live.unsubscribe(JOB, mine)
    live.unsubscribe(JOB, mine)
    live.changed(JOB)
    assert heard == ["mine", "mine", "theirs"]


def test_a_listener_that_fails_harms_nobody(caplog):
    live, heard = Live(), []

    def broken():
        raise RuntimeError("the connection is gone")

    live.subscribe(JOB, broken)
    live.subscribe(JOB, lambda: heard.append(1))
    live.changed(JOB)
    assert heard == [1] and "a listener failed" in caplog.text


def test_many_threads_lose_no_step():
    live = Live()
    live.begin(JOB, Kind.RECONSTRUCTION)

    def tell(number):
        for step in range(50):
            live.tell(JOB, f"step:{number}-{step}")
            live.progress(JOB)

    threads = [threading.Thread(target=tell, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(live.progress(JOB).steps) == 400
