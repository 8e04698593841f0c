"""A share of the random areas that ``python -m benchmarks.planner.random`` asks thousands of; and that it can fail."""

from dataclasses import replace

import pytest

from benchmarks.planner import random as bench
from photomap_gis.core.errors import PhotomapError
from photomap_gis.mission_planner.area import survey_area
from photomap_gis.mission_planner.survey import plan_survey


def test_a_share_of_the_areas_has_no_fault():
    found = bench.measure(30)
    assert found["told"] == []
    assert found["planned"] > 22
    assert found["planned"] + found["refused"] == 30


def test_a_number_is_one_area_wherever_the_run_begins():
    one = next(iter(bench.random_areas(1, first=7)))
    same = list(bench.random_areas(8))[7]
    assert one == same


@pytest.fixture(scope="module")
def flown():
    """An open area with several lanes, and its survey."""
    for asked in bench.random_areas(60):
        if asked.zones or asked.settings.inset:
            continue
        try:
            survey = plan_survey(survey_area(asked.polygons), asked.settings)
        except PhotomapError:
            continue
        if len(survey.lanes) > 4:
            return asked, survey
    raise AssertionError("no such area")


def test_a_lane_that_is_missing_is_found(flown):
    asked, survey = flown
    assert bench.coverage_faults(survey, asked.settings) == []
    half = replace(survey, lanes=survey.lanes[: len(survey.lanes) // 2])
    assert any("said to be covered" in words for words in bench.coverage_faults(half, asked.settings))


def test_ground_that_is_seen_and_told_as_uncovered_is_found(flown):
    asked, survey = flown
    calm = replace(asked.settings, model=replace(asked.settings.model, wind_east_m_s=0.0), fixed_heading=False)
    survey = plan_survey(survey_area(asked.polygons), calm)
    denied = replace(survey, left=survey.area.target)
    assert any("said to be uncovered" in words for words in bench.coverage_faults(denied, calm))


def test_what_breaks_is_a_crash_with_its_words(flown, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("boom")

    monkeypatch.setattr(bench, "plan_survey", broken)
    assert bench.faults(flown[0]) == ("crashed", ["crash: ZeroDivisionError: boom"])
    monkeypatch.setattr("sys.argv", ["random", "--areas", "1"])
    assert bench.main() == 1
