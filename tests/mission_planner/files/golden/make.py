"""Write the golden missions anew: python tests/mission_planner/files/golden/make.py, then look at the difference."""

import importlib.util
from pathlib import Path

from photomap_gis.core.mission import Autopilot
from photomap_gis.mission_planner.files import write_mission
from photomap_gis.mission_planner.items import to_mission

HERE = Path(__file__).parent


def main() -> None:
    spec = importlib.util.spec_from_file_location("plans", HERE.parent.parent / "conftest.py")
    assert spec is not None and spec.loader is not None
    plans = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(plans)
    for autopilot in Autopilot:
        for suffix in (".plan", ".waypoints"):
            write_mission(HERE / f"two_lanes_{autopilot}{suffix}", to_mission(plans._two_lanes(), 0, autopilot))


if __name__ == "__main__":
    main()
