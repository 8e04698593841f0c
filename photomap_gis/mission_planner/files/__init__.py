"""Plans and missions as files: each program's own format, written from a plan, and missions read back."""

from photomap_gis.mission_planner.files.missions import MISSION_SUFFIXES, read_mission, write_mission

__all__ = ["MISSION_SUFFIXES", "read_mission", "write_mission"]
