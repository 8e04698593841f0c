"""``python -m benchmarks.planner``: flight times over the corpus, ours and others', where they cover as much."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable

import numpy as np
import shapely

from benchmarks.planner.areas import BenchArea, areas
from benchmarks.planner.rivals import flight_s, grid
from photomap_gis.mission_planner.area import SurveyArea
from photomap_gis.mission_planner.flight_time import FlightModel
from photomap_gis.mission_planner.lanes import Lane
from photomap_gis.mission_planner.local_frame import LocalFrame
from photomap_gis.mission_planner.optics import Optics
from photomap_gis.mission_planner.proof import uncovered
from photomap_gis.mission_planner.survey import Survey, SurveySettings, plan_survey

BAR = 0.97
_OPTICS = Optics(5472, 3648, 5472 / 2 / math.tan(math.radians(73.74) / 2))
_HEIGHT_M = _OPTICS.height_m(0.02)


def main() -> int:
    """Print a table or, by ``--json``, a document; exit code 1 where the bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--areas", type=int, default=120)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    found = measure(chosen.areas)
    if chosen.json:
        print(json.dumps(found, indent=1))
    else:
        print(
            f"{found['areas']} areas, {found['uncovered']} not wholly covered by us, planned in {found['planning_s']} s"
        )
        for name, sums in found["rivals"].items():
            print(f"{name:<28} ours / theirs {sums['ratio']:.3f} over {sums['areas']} areas "
                  f"(convex {sums['ratio_convex']:.3f}, concave {sums['ratio_concave']:.3f})")  # fmt: skip
        print(f"against the best of them in each area: {found['ratio_best']:.3f} (bar {BAR})")
    return 0 if found["ratio_best"] <= BAR and not found["uncovered"] else 1


def measure(count: int) -> dict[str, object]:
    """Return sums of flight times; a rival's plan counts where it is sure to cover as much as ours."""
    rows: list[tuple[bool, float, dict[str, float]]] = []
    missing, planning = 0, 0.0
    for area in areas(count):
        model = FlightModel(wind_east_m_s=area.wind[0], wind_north_m_s=area.wind[1])
        began = time.perf_counter()
        survey = _ours(area, model)
        planning += time.perf_counter() - began
        missing += not survey.left.is_empty
        mine = flight_s(list(survey.lanes), model)
        theirs = {}
        for name, plan in _RIVALS.items():
            lanes = plan(area, survey, model)
            if uncovered(area.polygon, lanes, survey.spacing, survey.sure).area <= survey.left.area + 0.1:
                theirs[name] = flight_s(lanes, model)
        rows.append((area.convex, mine, theirs))
    compared = [(mine, min(theirs.values())) for _, mine, theirs in rows if theirs]
    return {
        "areas": len(rows),
        "compared": len(compared),
        "uncovered": missing,
        "planning_s": round(planning, 1),
        "ratio_best": _ratio(compared),
        "rivals": {
            name: {
                "areas": sum(name in t for _, _, t in rows),
                "ratio": _ratio([(m, t[name]) for _, m, t in rows if name in t]),
                "ratio_convex": _ratio([(m, t[name]) for c, m, t in rows if name in t and c]),
                "ratio_concave": _ratio([(m, t[name]) for c, m, t in rows if name in t and not c]),
            }
            for name in _RIVALS
        },
    }


def _ours(area: BenchArea, model: FlightModel) -> Survey:
    asked = SurveyArea(LocalFrame.about(47.0, 8.0), area.polygon, shapely.Polygon(), area.polygon)
    return plan_survey(asked, SurveySettings(_OPTICS, _HEIGHT_M, model=model))


def _ratio(pairs: list[tuple[float, float]]) -> float:
    return round(float(np.sum([a for a, _ in pairs]) / np.sum([b for _, b in pairs])), 4) if pairs else math.nan


_RIVALS: dict[str, Callable[[BenchArea, Survey, FlightModel], list[Lane]]] = {
    "sweep, north-south": lambda a, s, m: grid(a.polygon, s.spacing, m, 0.0),
    "sweep, best angle": lambda a, s, m: grid(a.polygon, s.spacing, m, None),
}

if __name__ == "__main__":
    raise SystemExit(main())
