"""What a waypoint's altitude is above the sea and above home, where that can be known."""

from __future__ import annotations

from photomap_gis.core.plan import AltitudeFrame, SurveyPlan, Waypoint, WaypointRole


def amsl_m(plan: SurveyPlan, waypoint: Waypoint) -> float | None:
    """Return metres above mean sea level; None where home's or the ground's height is not known."""
    if plan.frame is AltitudeFrame.AMSL and waypoint.role is not WaypointRole.LAND:
        return waypoint.alt_m
    over_home = above_home_m(plan, waypoint)
    if over_home is None or plan.home_alt_amsl_m is None:
        return None
    return round(plan.home_alt_amsl_m + over_home, 2)


def above_home_m(plan: SurveyPlan, waypoint: Waypoint) -> float | None:
    """Return metres above the take-off place; None where home's or the ground's height is not known."""
    if waypoint.role is WaypointRole.LAND:
        return 0.0
    if plan.frame is AltitudeFrame.RELATIVE or (
        plan.frame is AltitudeFrame.TERRAIN and waypoint.role is WaypointRole.TAKEOFF
    ):
        return waypoint.alt_m
    if plan.frame is AltitudeFrame.AMSL and plan.home_alt_amsl_m is not None:
        return round(waypoint.alt_m - plan.home_alt_amsl_m, 2)
    return None


FRAME_WORDS = {
    AltitudeFrame.RELATIVE: "above the take-off place",
    AltitudeFrame.AMSL: "above mean sea level",
    AltitudeFrame.TERRAIN: "above the ground below",
}
