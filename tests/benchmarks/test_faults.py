"""The benchmark of error frames: damage is measured, cases repeat themselves, and misses are counted."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.registration.faults import camera
from benchmarks.registration.faults.broken import RIM, Kind, make_faulty
from benchmarks.registration.faults.cases import FAULTY_SHARE, Case, repeats, strong_difference
from benchmarks.registration.faults.judging import Outcome, judge_case
from benchmarks.registration.faults.measure import batches, misses, section_of
from benchmarks.registration.faults.partly import Loss, error_share, make_partly
from benchmarks.registration.faults.sheet import write_sheet
from benchmarks.registration.faults.sound import Sound, make_sound
from benchmarks.registration.faults.streams import Codec, Coding, damage, decode, encode


@pytest.fixture(autouse=True)
def few(monkeypatch, scenes):
    """Two procedural scenes: nothing beside the repository is needed."""
    monkeypatch.setattr(camera, "sources", lambda part: scenes)


@pytest.fixture
def picture(rng):
    g = sum(s * cv2.GaussianBlur(rng.standard_normal((240, 320)), (0, 0), s) for s in (1.5, 4.0, 12.0))
    return np.clip(128 + 40 * g / g.std(), 0, 255).astype(np.uint8)


def test_noise_brightness_and_a_common_displacement_are_no_damage(rng, picture):
    noisy = np.clip(picture + 4 * rng.standard_normal(picture.shape), 0, 255).astype(np.uint8)
    assert strong_difference(picture, noisy).mean() < 0.002
    assert strong_difference(picture, np.clip(picture * 0.9 + 12, 0, 255).astype(np.uint8)).mean() < 0.002
    assert strong_difference(picture, np.roll(picture, 7, axis=1)).mean() < FAULTY_SHARE
    bent = cv2.remap(picture, *(g.astype(np.float32) for g in np.meshgrid(np.arange(320), np.arange(240))), 1)
    assert strong_difference(picture, bent, drifted=True).mean() == 0.0


def test_lost_rows_and_blocks_are_damage(picture):
    grey = picture.copy()
    grey[180:] = 128
    damaged = strong_difference(picture, grey)
    assert damaged[180:].mean() > 0.15 and damaged[:170].mean() == 0.0
    torn = picture.copy()
    torn[60:120] = np.roll(torn[60:120], 90, axis=1)
    damaged = strong_difference(picture, torn)
    assert damaged.mean() > FAULTY_SHARE and damaged[:50].mean() == 0.0


@pytest.mark.parametrize("codec", list(Codec))
def test_streams_decode_as_they_were_unless_damaged(rng, picture, codec):
    take = [np.roll(picture, 3 * k, axis=1) for k in range(8)]
    coding = Coding(codec, 24 if codec is Codec.H264 else 4, 8, 4)
    packets = encode(take, coding)
    shown = decode(packets, codec)
    assert sorted(shown) == list(range(8))
    assert all(np.abs(shown[k].astype(int) - take[k]).mean() < 6 for k in range(8))
    spoilt = damage(rng, packets, first=3, strokes=4)
    assert [p for p in spoilt[:3]] == packets[:3] and spoilt != packets
    again = decode(spoilt, codec)
    assert all((again[k] == shown[k]).all() for k in range(3))


@pytest.mark.parametrize("kind", list(Kind))
def test_every_kind_of_fault_is_made_and_told(kind):
    cases = [make_faulty(kind, seed, "reporting") for seed in range(3)]
    again = make_faulty(kind, 0, "reporting")
    assert (again.frame == cases[0].frame).all() and again.variety == cases[0].variety
    for case in cases:
        assert case.faulty and case.frame.dtype == np.uint8 and max(case.frame.shape) <= 512
        assert case.previous is not None and case.previous.shape == case.frame.shape
        if case.damaged is not None:
            assert case.damage >= FAULTY_SHARE
    told = [judge_case(c).detected for c in cases if c.variety != RIM]
    assert sum(told) >= len(told) - 1


@pytest.mark.parametrize("kind", [s for s in Sound if s not in (Sound.REAL, Sound.REAL_VIDEO)])
def test_every_kind_of_sound_frame_is_made_and_kept(kind):
    outcomes = []
    for seed in range(2):
        case = make_sound(kind, seed, "reporting")
        assert not case.faulty and (case.previous is None) == (kind is Sound.FIRST)
        assert case.previous is None or not repeats(case.frame, case.previous)
        outcomes.append(judge_case(case))
    assert not any(o.rejected for o in outcomes)


@pytest.mark.parametrize("loss", list(Loss))
def test_a_quarter_of_the_rows_lost_is_never_registered_wrongly(loss):
    case = make_partly(loss, 1, "reporting")
    assert case.clean is not None and case.H_previous_frame is not None
    rows = (case.frame != case.clean).mean(axis=1) > 0.3
    assert 0.15 < rows.mean() < 0.35
    assert error_share(case.H_previous_frame, case) == pytest.approx(0.0, abs=1e-9)
    moved = case.H_previous_frame.copy()
    moved[0, 2] += 0.02 * case.frame.shape[1] * moved[2, 2]
    assert error_share(moved, case) == pytest.approx(0.02, rel=0.2)
    outcome = judge_case(case)
    assert not outcome.wrong
    assert outcome.detected or loss is Loss.STALE, "where little moved, stale rows show nearly the same"


def outcome(kind, *, faulty=True, detected=True, rejected=False, variety="", wrong=False, masked=0.0):
    return Outcome(kind, variety, 0, faulty, detected, rejected, None, None, masked, False, 0.5, 256, wrong)


def test_figures_count_what_was_missed():
    good = [outcome(k.value) for k in Kind for _ in range(99)] + [outcome("video", faulty=False) for _ in range(199)]
    partly = [outcome("partly", variety="grey", masked=0.25), outcome("partly", variety="grey", rejected=True)]
    rim = [outcome("blocks", variety=RIM, detected=False)]
    fine = section_of([*good, *partly, *rim])
    assert fine.missed == () and misses([*good, *partly, *rim]) == []
    bad = [outcome("torn", detected=False)] * 2 + [outcome("video", faulty=False, rejected=True)] * 2
    section = section_of([*good, *partly, *bad])
    assert {f.name for f in section.missed} == {"torn: detected", "sound frames lost"}
    assert section["torn: detected"].value.value == pytest.approx(99 / 101)
    assert len(misses(bad)) == 4
    assert misses([replace(partly[0], wrong=True)])


def test_batches_are_disjoint_and_complete():
    todo = batches(50, 2, "reporting")
    seeds = [(b.group, b.kind, s) for b in todo for s in b.seeds]
    assert len(set(seeds)) == len(seeds)
    assert sum(k == "torn" for _, k, _ in seeds) == 50
    assert {b.group for b in todo} == {"faulty", "sound", "partly"}


def test_the_sheet_shows_every_case(tmp_path, picture):
    case = Case("torn", "shifted", True, picture, None)
    write_sheet(tmp_path / "sheet.png", [(case, f"number {k}") for k in range(4)])
    sheet = cv2.imread(str(tmp_path / "sheet.png"), cv2.IMREAD_GRAYSCALE)
    assert sheet.shape == (2 * 236, 3 * 660)
