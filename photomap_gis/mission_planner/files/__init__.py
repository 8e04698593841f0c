"""Plans and missions as files: each program's own format, written from a plan, and missions read back."""

from photomap_gis.mission_planner.files.missions import MISSION_SUFFIXES, read_mission, write_mission
from photomap_gis.mission_planner.files.plans import PLAN_FORMATS, plan_format, write_plan

__all__ = ["MISSION_SUFFIXES", "PLAN_FORMATS", "plan_format", "read_mission", "write_mission", "write_plan"]
