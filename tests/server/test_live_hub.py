"""Events on their way to listeners: newest first for who is slow, nothing lost for who comes back, nobody waits."""

import asyncio
import json

import pytest

from photomap_gis.core.grid import MapGrid
from photomap_gis.server.live_documents import (
    HealthDocument,
    LiveDocument,
    PoseDocument,
    SolutionDocument,
    TilesDocument,
)
from photomap_gis.server.live_hub import LiveHub, Views, merged
from photomap_gis.server.live_view import GpsState, LinkState, LivePhase, LivePicture

STATE = LiveDocument(
    epoch="e1", phase=LivePhase.FLYING, georeferenced=True, revision=0, version=3, elapsed_s=1.0, started_utc=None,
    pose=None, health=None, end=None, area=None,
)  # fmt: skip


def pose(frame: int) -> PoseDocument:
    return PoseDocument(frame=frame, time_s=frame / 30)


def tiles(version: int, *areas) -> TilesDocument:
    return TilesDocument(version=version, areas=list(areas))


def solution(revision: int) -> SolutionDocument:
    return SolutionDocument(revision=revision, frame=0, shift_px=None, georeferenced=True)


def parsed(data: bytes) -> tuple[str | None, dict]:
    lines = dict(line.split(": ", 1) for line in data.decode().strip().splitlines())
    return lines.get("id"), json.loads(lines["data"])


async def started() -> LiveHub:
    hub = LiveHub()
    hub.attach(asyncio.get_running_loop())
    return hub


async def tell(hub: LiveHub, *events) -> None:
    for event in events:
        hub.post(lambda event=event: event)
    await asyncio.sleep(0)
    await asyncio.sleep(0)


async def next_of(stream, n: int) -> list[tuple[str | None, dict]]:
    return [parsed(await anext(stream)) for _ in range(n)]


def test_a_slow_listener_gets_the_newest_pose_and_all_ground_that_changed():
    async def run():
        hub = await started()
        stream = hub.stream(lambda: STATE, None)
        [(_, state)] = await next_of(stream, 1)
        for n in range(1000):  # it does not read meanwhile
            await tell(hub, pose(n), tiles(n + 1, (n, 0.0, n + 1.0, 1.0)))
        await tell(hub, *(solution(r) for r in range(300)))
        return state, await next_of(stream, 130)

    state, got = asyncio.run(run())
    assert state["event"] == "live" and not state["missed"]
    names = [d["event"] for _, d in got]
    assert names == ["solution"] * 128 + ["tiles", "pose"]
    assert got[127][1]["revision"] == 299 and got[129][1]["frame"] == 999
    areas = got[128][1]["areas"]
    assert len(areas) <= 48 and min(a[0] for a in areas) == 0 and max(a[2] for a in areas) == 1000
    assert got[128][1]["version"] == 1000


def test_one_who_never_reads_costs_nobody_else_anything():
    async def run():
        hub = await started()
        asleep = [hub.stream(lambda: STATE, None) for _ in range(50)]
        for stream in asleep:
            await next_of(stream, 1)
        awake = hub.stream(lambda: STATE, None)
        await next_of(awake, 1)
        await tell(hub, pose(7))
        assert hub.listeners == 51
        [(_, got)] = await next_of(awake, 1)
        for stream in (*asleep, awake):
            await stream.aclose()
        assert hub.listeners == 0
        return got

    assert asyncio.run(run())["frame"] == 7


def test_who_comes_back_gets_what_was_missed():
    async def run():
        hub = await started()
        stream = hub.stream(lambda: STATE, None)
        [(first_id, _)] = await next_of(stream, 1)
        await tell(hub, solution(1))
        [(last_id, _)] = await next_of(stream, 1)
        await stream.aclose()
        await tell(hub, solution(2), tiles(9, (0.0, 0.0, 1.0, 1.0)), pose(5))
        back = await next_of(hub.stream(lambda: STATE, last_id), 3)
        all_ = await next_of(hub.stream(lambda: STATE, first_id), 3)
        lost = [
            (await next_of(hub.stream(lambda: STATE, id), 1))[0][1]["missed"]
            for id in ("zz-1", "99", f"{last_id.split('-')[0]}-99", f"{last_id.split('-')[0]}-\u0661", "-", "")
        ]
        await tell(hub, *(solution(r) for r in range(600)))
        late = await next_of(hub.stream(lambda: STATE, last_id), 1)
        return back, all_, lost, late

    back, all_, lost, late = asyncio.run(run())
    assert [d["event"] for _, d in back] == ["live", "solution", "tiles"] and back[1][1]["revision"] == 2
    assert [d.get("revision") for _, d in all_[1:]] == [1, 2]
    assert lost == [True] * 6 and late[0][1]["missed"]


def test_an_id_says_that_all_before_it_was_sent():
    """A page that loses its connection between two lines must not skip what had not been sent yet."""

    async def run():
        hub = await started()
        stream = hub.stream(lambda: STATE, None)
        await next_of(stream, 1)
        await tell(hub, solution(1), solution(2), tiles(4, (0.0, 0.0, 1.0, 1.0)))
        got = await next_of(stream, 3)
        return got, await next_of(hub.stream(lambda: STATE, got[2][0]), 1)

    got, again = asyncio.run(run())
    assert [id is None for id, _ in got] == [True, True, False]
    assert not again[0][1]["missed"]


def test_streams_end_with_the_server():
    async def run():
        hub = await started()
        stream = hub.stream(lambda: STATE, None)
        await next_of(stream, 1)
        await tell(hub, solution(1))
        hub.finish()
        rest = [parsed(data) async for data in stream]
        hub.post(lambda: pose(1))
        return rest

    assert [d["event"] for _, d in asyncio.run(run())] == ["solution"]
    hub = LiveHub()
    hub.post(lambda: pose(1))  # before the server listens nothing happens


def test_areas_are_joined():
    a, b = tiles(1, (0.0, 0.0, 1.0, 1.0)), tiles(3, (5.0, 5.0, 6.0, 7.0))
    assert merged(a, b) == merged(b, a).model_copy(update={"areas": [*a.areas, *b.areas]})
    assert merged(a, TilesDocument(version=2, all=True)).all
    many = tiles(1)
    for n in range(49):
        many = merged(many, tiles(n, (n, -1.0, n + 1.0, n)))
    assert many.areas == [(0.0, -1.0, 49.0, 48.0)]


def test_health_is_replaced_not_queued():
    async def run():
        hub = await started()
        stream = hub.stream(lambda: STATE, None)
        await next_of(stream, 1)
        for n in range(20):
            await tell(hub, HealthDocument(
                frames=n, fps=30.0, latency_ms=1.0, dropped=0, error_frames=0, keyframes=0, segments=1,
                link=LinkState.OK, gps=GpsState.NONE, words=[],
            ))  # fmt: skip
        return await next_of(stream, 1)

    assert asyncio.run(run())[0][1]["frames"] == 19


class Camera:
    """Somebody who makes pictures while watched."""

    def __init__(self) -> None:
        self.watchers, self.begun = [], 0

    def watch(self, on_picture):
        self.watchers.append(on_picture)
        self.begun += 1
        return lambda: self.watchers.remove(on_picture)

    def take(self, sequence: int) -> None:
        picture = LivePicture(sequence, 0, 0.0, MapGrid(None, 0.0, 0.0, 1.0, 2, 2), b"jpeg%d" % sequence)
        for watcher in list(self.watchers):
            watcher(picture)


@pytest.mark.parametrize("viewers", [1, 20])
def test_the_view_goes_to_all_who_wait_and_stops_with_the_last(viewers):
    async def run():
        camera = Camera()
        views = Views(camera.watch)
        waiting = [asyncio.create_task(views.after(-1, 5.0)) for _ in range(viewers)]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert camera.begun == 1
        camera.take(4)
        got = [p.sequence for p in await asyncio.gather(*waiting)]
        assert (await views.after(3, 5.0)).sequence == 4  # the newest is had at once
        assert await views.after(4, 0.01) is None
        late = asyncio.create_task(views.after(4, 60.0))
        await asyncio.sleep(0)
        views.close()
        assert await late is None and camera.watchers == [] and views.closed
        return got

    assert asyncio.run(run()) == [4] * viewers
