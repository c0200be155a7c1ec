"""Streams of events: every change of a job once, a place in the queue now and then, an end in every case."""

import asyncio
import json
from types import SimpleNamespace

import pytest
from conftest import need_service

JOB = "0" * 32


@pytest.fixture
def events(monkeypatch):
    need_service()
    from stereo_gpu.service.http import events

    monkeypatch.setattr(events, "LEAST_S", 0.0)
    return events


class Table:
    """What `look` sees of one job; counts how often it is asked."""

    def __init__(self, state="queued"):
        from stereo_gpu.service.live import Live
        from stereo_gpu.service.records import State

        self.live, self.looks, self.gone = Live(), 0, False
        self.told = {"state": State(state), "place": 5}

    def look(self):
        self.looks += 1
        told = dict(self.told)
        view = SimpleNamespace(state=told["state"], model_dump_json=lambda: json.dumps(told))
        return None if self.gone else view

    def set(self, **told):
        from stereo_gpu.service.records import State

        self.told |= {name: State(value) if name == "state" else value for name, value in told.items()}


def run(scenario):
    return asyncio.run(asyncio.wait_for(scenario, 60))


async def take(stream, heard):
    async for chunk in stream:
        heard.append(chunk.decode())


async def until(condition):
    while not condition():
        await asyncio.sleep(0.001)


def test_no_client_has_all_the_streams(events, monkeypatch):
    monkeypatch.setattr(events, "MOST_EACH", 2)

    async def scenario():
        from stereo_gpu.service.problems import Problem

        streams, table, heard = events.Streams(), Table(), []
        tasks = [
            asyncio.create_task(take(streams.follow(table.live, JOB, table.look, 0, "greedy"), heard)) for _ in range(2)
        ]
        await until(lambda: len(heard) == 2)
        with pytest.raises(Problem, match="2 streams of yours are open") as refused:
            streams.check_room("greedy")
        assert refused.value.status == 429 and refused.value.headers["Retry-After"]
        streams.check_room("other")
        streams.stop()
        await asyncio.gather(*tasks)
        streams.check_room("greedy")

    run(scenario())


def test_each_change_is_told_once_and_the_end_ends_it(events):
    async def scenario():
        from stereo_gpu.service.records import Kind

        table, heard = Table(), []
        reader = asyncio.create_task(take(events.Streams().follow(table.live, JOB, table.look, 3), heard))
        await until(lambda: len(heard) == 1)
        table.set(state="running", place=None)
        table.live.begin(JOB, Kind.RECONSTRUCTION)
        await until(lambda: len(heard) == 2)
        looks = table.looks
        table.live.changed(JOB)
        await until(lambda: table.looks > looks)
        table.set(state="done")
        table.live.end(JOB)
        await reader
        return heard

    heard = run(scenario())
    assert [chunk.splitlines()[1] for chunk in heard] == ["id: 3", "id: 4", "id: 5"]
    states = [json.loads(chunk.splitlines()[2].removeprefix("data: "))["state"] for chunk in heard]
    assert states == ["queued", "running", "done"] and all(chunk.endswith("\n\n") for chunk in heard)


def test_a_queue_that_moves_does_not_make_every_stream_look_every_time(events, monkeypatch):
    monkeypatch.setattr(events, "PLACE_S", 1e6)

    async def scenario():
        from stereo_gpu.service.records import Kind

        table, heard = Table(), []
        reader = asyncio.create_task(take(events.Streams().follow(table.live, JOB, table.look, 0), heard))
        await until(lambda: len(heard) == 1)
        for _ in range(200):
            table.live.queue_moved()
            await asyncio.sleep(0)
        assert table.looks == 1
        table.set(state="running")
        table.live.begin(JOB, Kind.RECONSTRUCTION)
        table.live.took(JOB, 0)  # which is told at once
        await until(lambda: len(heard) == 2)
        table.set(state="cancelled")
        table.live.end(JOB)
        await reader

    run(scenario())


def test_a_comment_shows_that_it_is_still_there(events, monkeypatch):
    monkeypatch.setattr(events, "COMMENT_S", 0.01)

    async def scenario():
        table, heard = Table("running"), []
        reader = asyncio.create_task(take(events.Streams().follow(table.live, JOB, table.look, 0), heard))
        await until(lambda: len(heard) == 4)
        table.gone = True  # deleted: there is nothing more to tell
        table.live.changed(JOB)
        await reader
        return heard

    heard = run(scenario())
    assert heard[0].startswith("event: job\n") and set(heard[1:]) == {": still here\n\n"}


@pytest.mark.parametrize("state", ["queued", "running"])
def test_a_stop_ends_all_streams(events, state):
    async def scenario():
        table, streams, heard = Table(state), events.Streams(), []
        readers = [asyncio.create_task(take(streams.follow(table.live, JOB, table.look, 0), heard)) for _ in range(9)]
        await until(lambda: len(heard) == 9)
        table.live.queue_moved()
        await asyncio.to_thread(streams.stop)
        await asyncio.gather(*readers)
        # One that is opened now tells how the job is, and ends.
        await take(streams.follow(table.live, JOB, table.look, 0), heard)
        assert len(heard) == 10 and not table.live._listeners

    run(scenario())
