"""What a job's process says becomes progress, words, documents and reasons."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from photomap_gis.cli.progress import MachineProgress
from photomap_gis.engine.output import Documents, error_of, progress_of, words_of


def test_machine_progress_is_read_back():
    machine = MachineProgress()
    lines = [machine.line("register", n, 100, n * 0.03) for n in range(101)]
    said = [progress_of(line) for line in lines if line is not None]
    assert (said[0].done, said[0].rate) == (0, None)
    assert (said[-1].done, said[-1].total, said[-1].eta_s) == (100, 100, 0.0)
    assert said[-1].rate == pytest.approx(1 / 0.03, rel=1e-3)
    assert 20 <= len(said) <= 35  # about ten a second of three seconds, not a hundred
    halfway = next(p for p in said if p.done >= 50)
    assert halfway.eta_s == pytest.approx((100 - halfway.done) * 0.03, abs=0.1)


def test_a_stage_that_begins_anew_or_was_resumed_tells_true_rates():
    machine = MachineProgress()
    assert json.loads(machine.line("render", 90, 100, 10.0))["rate"] is None
    assert json.loads(machine.line("render", 95, 100, 11.0))["rate"] == 5.0  # the 90 were there before
    machine.line("render", 100, 100, 12.0)
    assert machine.line("render", 100, 100, 12.5) is None
    assert json.loads(machine.line("render", 0, 50, 20.0)) == {
        "progress": "render", "done": 0, "total": 50, "rate": None, "eta_s": None,
    }  # fmt: skip


@given(st.text(max_size=80))
def test_other_lines_are_words(text):
    assert progress_of(text) is None
    assert progress_of('{"progress"' + text) is None or json.loads('{"progress"' + text)


@given(st.binary(max_size=60))
def test_any_bytes_are_words(data):
    assert isinstance(words_of(data), str)


documents = st.dictionaries(
    st.text(max_size=8), st.integers() | st.text(max_size=8) | st.lists(st.integers(), max_size=3)
)


@given(documents, st.sampled_from([None, 1]))
def test_a_document_over_many_lines_or_one_is_the_result(document, indent):
    found = Documents(1 << 20)
    told = [found.feed(line) for line in (json.dumps(document, indent=indent) + "\n").encode().splitlines(True)]
    assert found.result() == document
    assert [t for t in told if t is not None] == ([document] if indent is None or not document else [])


def test_of_a_stream_of_documents_the_last_is_the_result_and_memory_is_bounded():
    found = Documents(1000)
    for n in range(10_000):
        assert found.feed(b'{"n": %d}\n' % n) == {"n": n}
    assert found.result() == {"n": 9999}
    assert found.bytes < 1000
    assert not found.overflowed


def test_too_much_or_none_is_no_result():
    found = Documents(100)
    for _ in range(100):
        found.feed(b" 1234567\n")
    assert found.overflowed
    assert found.result() is None
    assert Documents(100).result() is None


@pytest.mark.parametrize(
    ("code", "log", "result", "name", "message"),
    [
        (3, ["photomap: no such file: check the name"], None, "data", "no such file: check the name"),
        (2, ["Usage: photomap map", "", "Error: Missing option"], None, "usage", "Missing option"),
        (3, ["photomap: first", "photomap: second,", "its end", "warning: w"], None, "data", "second,\nits end"),
        (4, ["said"], {"outcome": "refused", "message": "it flies"}, "link", "it flies"),
        (5, ["photomap: pip install photomap-gis[cluster]"], None, "extra", "pip install photomap-gis[cluster]"),
        (1, [], None, "fault", "failed with exit code 1"),
        (-9, ["rendering"], None, "crashed", None),
        (3221225477, [], None, "crashed", None),
    ],
)  # fmt: skip
def test_why_it_failed_is_in_its_own_words(code, log, result, name, message):
    error = error_of(code, log, result)
    assert (error.error, error.exit_code) == (name, code)
    if message is not None:
        assert error.message == message
    elif code == -9:
        assert "signal 9" in error.message and "memory" in error.message and "rendering" in error.message
