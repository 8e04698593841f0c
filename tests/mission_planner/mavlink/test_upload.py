"""Uploads end as they say they end, whatever vehicle, link, pilot, user and other stations do."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from photomap_gis.core.mission import Autopilot, Mission, MissionItem
from photomap_gis.mission_planner.mavlink.procedure import UploadOptions
from photomap_gis.mission_planner.mavlink.rules import Limits
from photomap_gis.mission_planner.mavlink.wire import Kind, lists_of
from photomap_gis.simulate.vehicle import Misbehaviour, Weather
from photomap_gis.simulate.vehicle.ardupilot import COPTER_AUTO, COPTER_LOITER
from photomap_gis.simulate.vehicle.px4 import PX4_MISSION

ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4


def test_a_clean_link_verifies(upload, autopilot):
    run = upload(autopilot, count=200)
    assert (run.report.outcome, run.report.holds, run.report.items) == ("verified", "new", 200)
    assert run.holds_new and not run.report.differences
    # What was there before is saved as it was, home item and all.
    assert len(run.saved[0][Kind.MISSION]) == (21 if autopilot is ARDUPILOT else 20)


def test_an_empty_vehicle_takes_a_mission(upload, autopilot):
    run = upload(autopilot, old_count=0)
    assert run.report.outcome == "verified" and run.holds_new
    assert run.saved[0] == {Kind.FENCE: (), Kind.RALLY: (), Kind.MISSION: ()}


def test_a_failed_upload_empties_what_was_empty(upload, autopilot):
    run = upload(autopilot, old_count=0, faults=Misbehaviour(refuses_command=16))
    assert run.report.outcome == "restored" and run.holds_old


@pytest.mark.parametrize("loss", [0.2, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_a_lossy_link_verifies(upload, autopilot, loss, seed):
    run = upload(autopilot, count=200, weather=Weather(loss=loss), seed=seed)
    assert run.report.outcome == "verified" and run.holds_new


def test_the_last_item_is_sent_again_unprompted(upload):
    """A sender that only answers requests waits for ArduPilot's second at every lost packet."""
    run = upload(ARDUPILOT, count=200, weather=Weather(loss=0.4))
    assert run.report.seconds < 400  # a second for each of 200 items, both ways, twice would be more


def test_duplicates_reordering_and_delay(upload, autopilot):
    run = upload(autopilot, weather=Weather(loss=0.1, duplicate=0.3, reorder=0.3, delay_s=0.1, jitter_s=0.2))
    assert run.report.outcome == "verified" and run.holds_new


def test_a_slow_link(upload, autopilot):
    run = upload(autopilot, count=20, weather=Weather(delay_s=1.2))
    assert run.report.outcome == "verified" and run.holds_new


def test_no_space_just_after_boot_is_waited_for(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(no_space_after_boot_s=9))
    assert run.report.outcome == "verified" and run.holds_new


def test_no_space_at_all_is_a_refusal(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(no_space_after_boot_s=1e9))
    assert (run.report.outcome, run.report.holds) == ("refused", "previous")
    assert run.holds_old and "NO_SPACE" in run.report.message


def test_more_items_than_there_is_room_for(upload, autopilot):
    run = upload(autopilot, count=652)
    assert run.report.outcome == "restored" and run.holds_old and "NO_SPACE" in run.report.message


def test_a_reboot_in_mid_upload(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(reboot_at_item=30, no_space_after_boot_s=4))
    assert run.vehicle.boots == 1 and run.report.outcome == "verified" and run.holds_new


def test_a_refused_item_puts_the_old_back(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(refuses_command=16))
    assert run.report.outcome == "restored" and run.holds_old
    assert "item 2 with UNSUPPORTED" in run.report.message or autopilot is ARDUPILOT  # there home is a waypoint too
    assert "UNSUPPORTED" in run.report.message and run.report.saved_previous == "saved.json"


def test_a_vehicle_that_falls_silent_is_unknown(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(silent_at_item=30), timeout_s=40)
    assert (run.report.outcome, run.report.holds) == ("unknown", "unknown")
    assert "may hold" in run.report.message and "--restore" in run.report.message
    assert run.report.seconds > 40  # never before the whole stated time


def test_a_vehicle_that_does_not_answer_is_untouched(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(ignores_us=True), timeout_s=20)
    assert run.report.outcome == "unknown" and run.holds_old and "nothing was changed" in run.report.message


def test_an_echo_that_is_wrong_once_is_read_again(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(wrong_echoes=1))
    assert run.report.outcome == "verified" and run.holds_new


def test_what_is_kept_wrong_is_sent_again(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(keeps_wrong=1))
    assert run.report.outcome == "verified" and run.holds_new


def test_what_is_always_kept_wrong_is_never_verified(upload, autopilot):
    run = upload(autopilot, faults=Misbehaviour(keeps_wrong=10**6))
    assert (run.report.outcome, run.report.holds) == ("refused", "mixed")
    assert run.report.differences[0].field == "latitude" and "could not be put back" in run.report.message


@pytest.mark.parametrize("stop_s", [0.5, 4.0, 6.0, 8.0, 10.0])
def test_a_stop_leaves_a_known_condition(upload, autopilot, stop_s):
    def stop(now_s, link, talk):
        talk.stop_asked = now_s >= stop_s

    run = upload(autopilot, count=200, at=stop)
    assert run.report.outcome in ("restored", "refused") and run.report.holds == "previous"
    assert run.holds_old and "stopped by the user" in run.report.message


def test_another_station_that_downloads_and_sends_items_does_no_harm(upload, autopilot):
    def other(now_s, link, talk):
        if round(now_s * 20) % 7 == 0:
            link.inject(mavlink.MAVLink_mission_request_list_message(1, 1, 0), (255, 190))
            link.inject(mavlink.MAVLink_mission_item_int_message(1, 1, 3, 3, 16, 0, 1, 0, 0, 0, 0, 9, 9, 9), (255, 190))

    run = upload(autopilot, at=other)
    assert not run.claims_falsely
    if autopilot is ARDUPILOT:  # PX4 serves one station at a time and may be kept busy
        assert run.report.outcome == "verified"


def test_another_station_that_uploads_first_is_waited_for(upload):
    def other(now_s, link, talk):
        if 2 < now_s < 3 and round(now_s * 20) % 10 == 0:
            link.inject(mavlink.MAVLink_mission_count_message(1, 1, 5, 0), (255, 190))

    run = upload(ARDUPILOT, at=other)
    assert run.report.outcome == "verified" and run.holds_new


def test_another_station_that_overwrites_is_noticed(upload):
    def other(now_s, link, talk):  # an upload of one item the moment ours is complete
        if link.vehicle.count_for(0) == 61 and not link.vehicle.receiving:
            link.inject(mavlink.MAVLink_mission_count_message(1, 1, 1, 0), (255, 190))
            link.inject(mavlink.MAVLink_mission_item_int_message(1, 1, 0, 0, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0), (255, 190))

    run = upload(ARDUPILOT, at=other, timeout_s=30)
    assert not run.claims_falsely


def test_ardupilot_in_auto_is_refused_untouched(upload):
    for armed in (False, True):
        run = upload(ARDUPILOT, prepare=lambda v, armed=armed: (v.set_mode(COPTER_AUTO), setattr(v, "armed", armed)))
        assert (run.report.outcome, run.report.holds) == ("refused", "previous")
        assert run.holds_old and "--wait-mode" in run.report.message and not run.saved


def test_wait_mode_waits_for_the_pilot(upload):
    def pilot(now_s, link, talk):
        if now_s > 100 and link.vehicle.mode == COPTER_AUTO:
            link.vehicle.set_mode(COPTER_LOITER)

    run = upload(
        ARDUPILOT,
        prepare=lambda v: v.set_mode(COPTER_AUTO),
        at=pilot,
        options=UploadOptions(waits_for_mode=True),
    )
    assert run.report.outcome == "verified" and run.holds_new and run.report.seconds > 100


def test_auto_in_mid_upload_stops_and_tells_what_is_there(upload):
    run = upload(ARDUPILOT, faults=Misbehaviour(mission_mode_at_item=30))
    assert (run.report.outcome, run.report.holds) == ("refused", "mixed")
    assert not run.holds_new and not run.holds_old
    assert "AUTO" in run.report.message and "holds the first" in run.report.message
    kept = run.vehicle.lists[0]
    assert f"the first {len(kept) - 1}" in run.report.message  # home is not counted


def test_px4_replaces_an_active_mission_only_when_told(upload):
    def flying(vehicle):
        vehicle.armed, vehicle.mode, vehicle.place.height_m = True, PX4_MISSION, 50.0

    run = upload(PX4, prepare=flying)
    assert run.report.outcome == "refused" and run.holds_old and "--replace-active" in run.report.message
    run = upload(PX4, prepare=flying, options=UploadOptions(replaces_active=True))
    assert run.report.outcome == "verified" and run.holds_new


def test_px4_that_begins_its_mission_in_mid_upload_keeps_the_old(upload):
    run = upload(PX4, faults=Misbehaviour(mission_mode_at_item=30), prepare=lambda v: setattr(v, "armed", True))
    # The lists before it are the new ones by then; the mission is swapped in whole or not at all.
    assert (run.report.outcome, run.report.holds) == ("refused", "mixed") and len(run.vehicle.lists[0]) == 20
    assert "the fence is the new" in run.report.message and "the mission is as before" in run.report.message


def test_replace_active_is_no_word_for_ardupilot(upload):
    run = upload(
        ARDUPILOT,
        prepare=lambda v: v.set_mode(COPTER_AUTO),
        options=UploadOptions(replaces_active=True),
    )
    assert run.report.outcome == "refused" and run.holds_old


def test_nothing_is_armed_no_mode_changed_no_mission_started(upload, autopilot):
    run = upload(autopilot)
    assert not run.vehicle.armed and run.vehicle.mode == 0


def _in_air(vehicle):
    vehicle.armed, vehicle.place.height_m, vehicle.place.lat_deg = True, 50.0, 51.5003


def _lines(survey_items=3):
    """A take-off, then lines with the camera on from their first to their second waypoint."""
    items = [MissionItem(22, 3, z=40.0)]
    for n in range(survey_items):
        lat = 51.5 + n * 3e-4
        items += [
            MissionItem(16, 3, (0.0,) * 4, lat, 7.4, 50.0),
            MissionItem(206, 2, (12.5, 0.0, 1.0, 0.0)),
            MissionItem(16, 3, (0.0,) * 4, lat, 7.405, 50.0),
            MissionItem(206, 2),
        ]
    return tuple(items)


@pytest.mark.parametrize(("start_at", "item"), [(None, 2), (7, 7), ("nearest", 6)])
def test_in_the_air_the_current_item_is_set(upload, autopilot, start_at, item):
    run = upload(autopilot, mission=Mission(_lines()), prepare=_in_air, options=UploadOptions(start_at=start_at))
    assert run.report.outcome == "verified" and run.report.start_item == item
    assert run.vehicle.current == (item if autopilot is ARDUPILOT else item - 1)
    assert "switch to AUTO when ready" in run.report.message


def test_on_the_ground_the_current_item_is_left(upload, autopilot):
    run = upload(autopilot)
    assert run.report.start_item is None and run.vehicle.current == 0


def test_a_start_beyond_the_mission_is_refused_before_anything(upload, autopilot):
    run = upload(autopilot, options=UploadOptions(start_at=61))
    assert run.report.outcome == "refused" and run.holds_old and "items 1 to 60" in run.report.message


def test_a_broken_rule_leaves_the_vehicle_untouched(upload, autopilot):
    run = upload(autopilot, options=UploadOptions(limits=Limits(height_m=30)))
    assert run.report.outcome == "refused" and run.holds_old and "--max-height" in run.report.message
    assert not run.saved


def test_a_plan_without_a_fence_is_judged_by_the_vehicles_own(upload, autopilot, make_survey):
    outside = replace(make_survey(5), fence_polygons=(), rally=())
    outside = replace(outside, items=(*outside.items, MissionItem(16, 3, (0.0,) * 4, 51.53, 7.4, 50.0)))
    run = upload(autopilot, mission=outside)
    assert run.report.outcome == "refused" and "fence" in run.report.message
    assert len(run.vehicle.lists[Kind.FENCE]) == 4


_faults = st.builds(
    Misbehaviour,
    no_space_after_boot_s=st.sampled_from([0.0, 5.0]),
    reboot_at_item=st.none() | st.integers(0, 25),
    mission_mode_at_item=st.none() | st.integers(0, 25),
    silent_at_item=st.none() | st.integers(0, 25),
    wrong_echoes=st.sampled_from([0, 1, 2, 5]),
    keeps_wrong=st.sampled_from([0, 1, 3]),
)
_weather = st.builds(
    Weather,
    loss=st.sampled_from([0.0, 0.1, 0.3, 0.5]),
    duplicate=st.sampled_from([0.0, 0.2]),
    reorder=st.sampled_from([0.0, 0.2]),
    delay_s=st.sampled_from([0.0, 0.05, 0.5]),
)


@settings(max_examples=60, deadline=None)
@given(
    autopilot=st.sampled_from(list(Autopilot)),
    faults=_faults,
    weather=_weather,
    seed=st.integers(0, 1000),
    stop_s=st.none() | st.floats(0.0, 60.0),
    armed=st.booleans(),
)
def test_no_run_ends_with_a_false_claim(upload, autopilot, faults, weather, seed, stop_s, armed):
    def at(now_s, link, talk):
        talk.stop_asked = stop_s is not None and now_s >= stop_s

    run = upload(
        autopilot, count=26, old_count=12, faults=faults, weather=weather, seed=seed, at=at, timeout_s=30,
        prepare=lambda v: setattr(v, "armed", armed),
    )  # fmt: skip
    assert not run.claims_falsely
    assert run.report.outcome in ("verified", "restored", "refused", "unknown")
    if run.report.outcome == "unknown":
        assert run.report.seconds > 30


def test_lists_of_a_mission_without_a_fence_leave_the_fence_out():
    assert set(lists_of(Mission(_lines()), PX4)) == {Kind.MISSION}


def test_only_what_is_replaced_is_saved(upload, autopilot):
    run = upload(autopilot, mission=Mission(_lines()))
    assert run.report.outcome == "verified" and set(run.saved[0]) == {Kind.MISSION}
    assert len(run.vehicle.lists[Kind.FENCE]) == 4 and len(run.vehicle.lists[Kind.RALLY]) == 1  # left as they were
