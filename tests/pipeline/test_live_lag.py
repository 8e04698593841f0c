"""The lag between video and telemetry: known truth, told back by the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from photomap_gis.core.frame import GpsFix, TrackFix
from photomap_gis.core.live import FrameMoment
from photomap_gis.georef import choose_map_frame
from photomap_gis.pipeline.live_lag import picture_lag
from photomap_gis.simulate.vehicle.flying import FlownPath
from tests.ingest.stream.made import FakeClock
from tests.ingest.stream.test_telemetry import Air, listening, path_of

MAP = choose_map_frame([GpsFix(51.5, 7.4)], None)


def place_m(at_s: np.ndarray) -> np.ndarray:
    """``(N, 2)`` east and north: a flight that turns now this way and now that."""
    return np.stack([60.0 * np.sin(0.11 * at_s), 40.0 * np.sin(0.23 * at_s + 0.5)], axis=-1)


def flown_path(seconds: float) -> FlownPath:
    t = np.arange(0.0, seconds, 0.2)
    east, north = place_m(t).T
    return replace(
        path_of(seconds), times_s=t, lat_deg=51.5 + north / 111_195.0, lon_deg=7.4 + east / 69_220.0,
        **{name: np.zeros(len(t)) for name in ("yaw_rad", "pitch_rad", "roll_rad", "alt_m", "height_m")},
    )  # fmt: skip


@pytest.mark.parametrize("late_s", [0.4, 1.7, -0.5])
def test_the_latency_of_the_video_is_told_back(late_s: float, rng: np.random.Generator) -> None:
    clock = FakeClock()
    telemetry = listening(clock)
    air = Air(clock, flown_path(130.0))
    moments, taken_s = [], []
    for n in range(1200):
        telemetry.take(air.step(0.1))
        if n % 5 == 0:
            moments.append(FrameMoment(n * 0.1, clock.now_s()))
            taken_s.append(clock.now_s() - 1000.0 - late_s)  # what comes now was seen then
    # by image motion, in a frame of its own: scaled, y down, drifting a little
    seen = 3.0 * place_m(np.array(taken_s)) * (1.0, -1.0) + 7.0 + rng.normal(0.0, 0.2, (len(taken_s), 2))
    times_s = np.array([m.stream_time_s for m in moments])
    found = picture_lag(times_s, seen, telemetry.place(moments), MAP)
    assert found is not None and found.lag_s == pytest.approx(late_s, abs=max(0.1, 3.0 * found.sigma_s))
    telemetry.set_lag(found.lag_s, found.sigma_s)
    again = picture_lag(times_s, seen, telemetry.place(moments), MAP)  # and then it is gone
    telemetry.close()
    assert again is not None and abs(again.lag_s) < 0.1


def test_a_straight_flight_tells_no_lag() -> None:
    times_s = np.arange(60.0)
    placed = [TrackFix(t, GpsFix(51.5 + 1e-5 * t, 7.4)) for t in times_s.tolist()]
    assert picture_lag(times_s, np.stack([times_s, 0.0 * times_s], axis=1), placed, MAP) is None
    assert picture_lag(times_s, np.zeros((60, 2)), [None] * 60, MAP) is None
