"""Methods, runs and reports: one interface, the same in any number of processes, and honest tables."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.registration import __main__ as program
from benchmarks.registration import running
from benchmarks.registration.methods import CURVE, TRACKING, Estimate, Method, method_named, prior_of
from benchmarks.registration.pairs import pairs
from benchmarks.registration.reference import overlap_grid, read_reference
from benchmarks.registration.report import Bar, Figure, Section, Table, document, interval, markdown
from benchmarks.registration.running import Job, Options, judge, only, run, together
from benchmarks.registration.score import Interval, error_of, is_right
from benchmarks.registration.sheet import draw_pair
from benchmarks.registration.success import section_of
from photomap_gis.core.similarity import Similarity2D


@pytest.fixture
def few(monkeypatch, scenes):
    monkeypatch.setattr(running, "_sources", lambda part: scenes)


@pytest.mark.parametrize("name", ["ifmi", "ifmi+features", "ifmi-tracking", "paper", "orb", "sift", CURVE[0].name])
def test_every_method_finds_an_easy_motion(scenes, name):
    method = method_named(name)
    for pair in pairs("nominal", 2, 21, sources=scenes):
        prior = prior_of(pair, TRACKING, np.random.default_rng(0)) if method.wants_prior else None
        estimate = method(pair.a, pair.b, prior)
        assert is_right(error_of(estimate.T_a_b, pair).rms_px, 256)
        assert estimate.accepted


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_imreg_dft_finds_it_too(scenes):
    pytest.importorskip("imreg_dft", reason="the extra 'bench' is not installed")
    for pair in pairs("nominal", 2, 21, sources=scenes):
        assert error_of(method_named("imreg_dft")(pair.a, pair.b).T_a_b, pair).rms_px < 3.0


def test_features_abstain_on_nothing():
    flat = np.full((64, 64), 90, np.uint8)
    for name in ("orb", "sift"):
        assert not method_named(name)(flat, flat).accepted
    with pytest.raises(ValueError, match="one of"):
        method_named("magic")


def test_priors_err_as_they_say(scenes):
    (pair,) = pairs("nominal", 1, 3, sources=scenes)
    rng = np.random.default_rng(1)
    off = []
    for _ in range(400):
        prior = prior_of(pair, TRACKING, rng)
        d = prior.T_a_b.apply((127.5, 127.5)) - pair.T_a_b.apply((127.5, 127.5))
        turn = prior.T_a_b.angle_rad - pair.T_a_b.angle_rad
        off.append([*(d / prior.sigma_xy_px), turn / prior.sigma_angle_rad])
    assert np.std(off, axis=0) == pytest.approx([1.0, 1.0, 1.0], abs=0.15)


def test_outcomes_do_not_hang_on_the_number_of_processes():
    """Scenes are always there; other sources may be, here and in the other processes alike."""
    jobs = [Job("wrong", ("paper",), 3), Job("tilt-0", ("paper", "orb"), 2)]
    one = run(jobs, Options(seed=4))
    two = run(jobs, Options(seed=4, processes=2))
    assert [(o.cls, o.index, o.method, o.rms_px, o.accepted) for o in one] == [
        (o.cls, o.index, o.method, o.rms_px, o.accepted) for o in two
    ]
    assert [(o.method, o.index) for o in only(one, cls="tilt-0")] == [
        ("paper", 0),
        ("orb", 0),
        ("paper", 1),
        ("orb", 1),
    ]


def test_jobs_make_each_pair_once():
    jobs = together("nominal", {"a": 10, "b": 3, "c": 10})
    assert [(j.methods, j.first, j.count) for j in jobs] == [(("a", "b", "c"), 0, 3), (("a", "c"), 3, 7)]


def test_progress_is_told(few):
    told = []
    run([Job("tilt-0", ("paper",), 2)], Options(on_progress=lambda done, total: told.append((done, total))))
    assert told == [(0, 2), (2, 2)]


def test_a_pair_without_truth_is_never_right(scenes):
    (pair,) = pairs("wrong", 1, 0, sources=scenes)
    credulous = Method("x", lambda g: g, lambda a, b, p: Estimate(Similarity2D.identity(), True, 1.0))
    outcome = judge(credulous, pair, 0)
    assert outcome.accepted and not outcome.right and math.isinf(outcome.rms_px)


def test_sections_count_what_outcomes_say(few):
    (first,) = run([Job("nominal", ("paper",), 1)], Options())
    made = [
        replace(first, method=m, cls=c, index=k, right=(c != "blur" or k < 3), rms_px=0.5)
        for m in ("ifmi", "ifmi+features")
        for c in ("nominal", "blur")
        for k in range(4)
    ]
    section = section_of(made, Options(), ("nominal", "blur"))
    assert section["nominal"].value.value == 1.0 and section["nominal"].met
    assert section["blur"].value.value == 0.75 and not section["blur"].met
    assert section["all classes, iFMI alone"].value.value == 0.875
    assert {f.name for f in section.missed} >= {"blur", "all classes, iFMI alone"}
    with pytest.raises(KeyError, match="no figure"):
        section["magic"]


def test_bars_are_met_by_the_point_value():
    figure = Figure("x", Interval(0.99, 0.9, 1.0), 10, "%", Bar(low=0.99))
    assert figure.met
    assert not replace(figure, value=Interval(0.9899, 0.9, 1.0)).met
    assert not replace(figure, value=Interval(math.nan, 0.0, 1.0)).met
    assert replace(figure, bar=None, value=Interval(math.nan, 0.0, 1.0)).met
    assert not replace(figure, bar=Bar(0.92, 0.98)).met


def test_reports_say_figure_interval_bar_and_whether_it_is_met():
    section = Section(
        "trial",
        (
            Figure("share", Interval(0.5, 0.4, 0.6), 9, "%", Bar(low=0.9)),
            Figure("ms", Interval(3.0, 2.0, 4.0), 9, "ms"),
        ),
        (Table("more", ("a", "b"), (("1", "2"),)),),
        ("a remark",),
    )
    text = markdown(section)
    assert "50.00 [40.00, 60.00]" in text and ">= 90.00" in text and "MISSED" in text and "a remark" in text
    assert len({len(line) for line in text.splitlines() if line.startswith("| share") or line.startswith("| ms")}) == 1
    assert interval(Interval(math.nan, math.nan, math.nan), "px") == "- [-, -]"
    again = json.loads(json.dumps(document(section)))
    assert again["figures"][0]["met"] is False and again["figures"][0]["bar"] == [0.9, None]


def test_the_program_measures_and_tells_by_its_exit_code(tmp_path, capsys, monkeypatch):
    good = Section("accuracy", (Figure("x", Interval(1.0, 1.0, 1.0), 1, "", Bar(low=0.5)),))
    monkeypatch.setitem(program.SECTIONS, "accuracy", lambda options: good)
    assert program.main(["--only", "accuracy", "--json", str(tmp_path / "o.json")]) == 0
    assert json.loads((tmp_path / "o.json").read_text())[0]["section"] == "accuracy"
    bad = Section("accuracy", (Figure("x", Interval(0.1, 0.1, 0.1), 1, "", Bar(low=0.5)),))
    monkeypatch.setitem(program.SECTIONS, "accuracy", lambda options: bad)
    assert program.main(["--only", "accuracy", "--quick"]) == 1
    assert "accuracy: x" in capsys.readouterr().out


def test_a_pair_is_drawn_with_its_truth(scenes):
    (pair,) = pairs("nominal", 1, 3, sources=scenes)
    drawn = draw_pair(pair)
    assert drawn.shape == (256, 768, 3)
    (wrong,) = pairs("wrong", 1, 3, sources=scenes)
    assert not draw_pair(wrong)[:, 512:].any()


def test_the_committed_reference_is_whole_and_sane():
    references = read_reference()
    assert {f: (len(r), sum(x.T_a_b is not None for x in r)) for f, r in references.items()} == {
        "caliterra": (74, 74),
        "seneca": (166, 108),
    }
    for r in (x for flight in references.values() for x in flight if x.T_a_b is not None):
        assert r.inliers >= 20 and 0.03 <= r.overlap <= 1.0
        assert len(overlap_grid(r.T_a_b)) / 32**2 == pytest.approx(r.overlap, abs=0.08)
