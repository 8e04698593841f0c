"""Events are kept in order and in bounds, and a listener misses nothing of what counts."""

import asyncio

from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.engine.documents import EndDocument, JobState, LogDocument, ProgressDocument
from photomap_gis.engine.history import History


def progress(history: History, stage: str, done: int) -> None:
    history.add("progress", ProgressDocument(stage=stage, done=done, total=10), key=stage)


@given(st.lists(st.sampled_from(["log", "read", "draw"]), max_size=60), st.integers(0, 60))
def test_numbers_rise_and_of_each_stage_the_newest_is_kept(said, after):
    history = History()
    for n, what in enumerate(said):
        if what == "log":
            history.add("log", LogDocument(line=str(n)))
        else:
            progress(history, what, n)
    events, closed = history.after(0)
    assert not closed
    numbers = [e.number for e in events]
    assert numbers == sorted(set(numbers))
    assert sum(e.name == "log" for e in events) == said.count("log")
    last = {what: n for n, what in enumerate(said, start=1) if what != "log"}
    assert sorted(e.number for e in events if e.name == "progress") == sorted(last.values())
    assert history.after(after)[0] == [e for e in events if e.number > after]


def test_it_is_bounded_and_nothing_comes_after_the_end():
    history = History()
    progress(history, "read", 1)
    for n in range(5000):
        history.add("log", LogDocument(line=str(n)))
    history.add("end", EndDocument(state=JobState.DONE))
    history.add("log", LogDocument(line="late"))
    events, closed = history.after(0)
    assert closed
    assert len(events) == 1500
    assert events[-1].name == "end"


def test_a_listener_hears_what_comes_while_it_listens():
    async def listen() -> list[bytes]:
        history = History()
        history.add("log", LogDocument(line="before"))
        heard = []
        stream = history.stream(0)
        heard.append(await anext(stream))
        coming = asyncio.ensure_future(anext(stream))
        await asyncio.sleep(0)  # let it begin to wait
        await asyncio.to_thread(history.add, "end", EndDocument(state=JobState.DONE, result={"a": "line\nbreak"}))
        heard.append(await coming)
        assert [e async for e in stream] == []
        return heard

    first, last = asyncio.run(listen())
    assert first == b'id: 1\nevent: log\ndata: {"line":"before"}\n\n'
    assert last.startswith(b"id: 2\nevent: end\ndata: {")
    assert last.count(b"\n") == 4  # what is told holds no line breaks of its own
