"""Uploads over bad links: how many verify, how long they take, and whether any report is false.

``python -m benchmarks.planner.links`` runs the product's exchange against the simulated vehicle in simulated time (a
run of minutes takes a tenth of a second), and a few uploads over real UDP in real time. What a vehicle truly holds is
compared with what the report claims. The exit code is 1 where a limit is broken.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photomap_gis.core.mission import Autopilot, FencePolygon, Mission, MissionItem, RallyPoint
from photomap_gis.mission_planner.mavlink.compare import compare
from photomap_gis.mission_planner.mavlink.procedure import UploadOptions, upload_mission
from photomap_gis.mission_planner.mavlink.report import Report
from photomap_gis.mission_planner.mavlink.session import Connection, run
from photomap_gis.mission_planner.mavlink.talk import Address, Patience, Steps, Talk, converse
from photomap_gis.mission_planner.mavlink.wire import Kind, WireItem, lists_of
from photomap_gis.simulate.vehicle import PX4, Airframe, ArduPilot, Misbehaviour, VirtualLink, Weather

ITEMS, OLD_ITEMS = 200, 30
LIMITS = {0.2: 0.99, 0.4: 0.90}
VEHICLES: dict[Autopilot, type[Airframe]] = {Autopilot.ARDUPILOT: ArduPilot, Autopilot.PX4: PX4}


@dataclass(frozen=True, slots=True)
class Case:
    """A link and a vehicle with faults; ``stop_s`` is when the user stops."""

    name: str
    weather: Weather
    faults: Misbehaviour
    stop_s: float | None = None


def survey(count: int, shift_deg: float = 0.0) -> Mission:
    """A take-off, waypoints and camera commands inside a fence, with a rally point."""
    items = [MissionItem(22, 3, (0.0, 0.0, 0.0, math.nan), 51.5, 7.4, 40.0)]
    for n in range(1, count):
        if n % 4 == 2:
            items.append(MissionItem(206, 2, (12.5, 0.0, 1.0, 0.0)))
        elif n % 4 == 0:
            items.append(MissionItem(206, 2))
        else:
            items.append(MissionItem(16, 3, (0.0, 0.0, 0.0, math.nan), 51.5 + shift_deg + n * 1e-5, 7.4, 50.123))
    fence = FencePolygon(((51.49, 7.39), (51.49, 7.41), (51.52, 7.41 + shift_deg), (51.52, 7.39)))
    return Mission(tuple(items), (fence,), rally=(RallyPoint(51.5 + shift_deg, 7.4, 30.0),))


def truly_holds(vehicle: Airframe, mission: Mission, autopilot: Autopilot) -> bool:
    """Whether a vehicle's storage, which no link has touched, is a mission."""
    lists = lists_of(mission, autopilot)
    for kind in Kind:
        kept = tuple(WireItem(i.command, i.frame, i.params, i.x, i.y, i.z) for i in vehicle.lists[kind])
        if not compare(kind, lists[kind], kept, autopilot).is_same:
            return False
    return True


def steps(talk: Talk, mission: Mission) -> Steps[Report]:
    """Return the product's upload without files."""
    return upload_mission(talk, mission, UploadOptions(), save=lambda state, lists: "", say=lambda words: None)


def upload_once(autopilot: Autopilot, case: Case, seed: int) -> tuple[Report, bool]:
    """Upload over a bad link to a vehicle that holds another mission; return the report and whether it is false."""
    old, new = survey(OLD_ITEMS, 0.001), survey(ITEMS)
    first = VEHICLES[autopilot]()
    talk = Talk(Address(254, 190), Patience())
    if converse(talk, steps(talk, old), VirtualLink(first)).outcome != "verified":
        raise RuntimeError("the old mission did not get there over a perfect link")
    f = case.faults
    faults = Misbehaviour(**{name: getattr(f, name) for name in Misbehaviour.__slots__})
    vehicle = VEHICLES[autopilot](lists=first.lists, faults=faults)
    talk = Talk(Address(254, 190), Patience())

    def at(now_s: float, _: VirtualLink) -> None:
        talk.stop_asked = case.stop_s is not None and now_s >= case.stop_s

    report = converse(talk, steps(talk, new), VirtualLink(vehicle, case.weather, seed=seed, at=at))
    is_new, is_old = truly_holds(vehicle, new, autopilot), truly_holds(vehicle, old, autopilot)
    is_false = (report.holds == "new" and not is_new) or (report.holds == "previous" and not is_old)
    is_false |= (report.outcome == "verified" and not is_new) or (report.outcome == "restored" and not is_old)
    is_false |= report.outcome == "unknown" and report.seconds < talk.patience.timeout_s
    return report, is_false


def cases(seed: int) -> list[Case]:
    """Return every fault, placed by a seed."""
    rng = np.random.default_rng(seed)
    item = int(rng.integers(1, ITEMS - 1))
    loss = Weather(loss=float(rng.choice([0.0, 0.1, 0.2])))
    return [
        Case("duplicates, reordering, delay", Weather(0.1, 0.2, 0.2, 0.1, 0.2), Misbehaviour()),
        Case("a slow link (1 s each way)", Weather(delay_s=1.0), Misbehaviour()),
        Case("NO_SPACE just after boot", loss, Misbehaviour(no_space_after_boot_s=12.0)),
        Case("a reboot in mid upload", loss, Misbehaviour(reboot_at_item=item, no_space_after_boot_s=3.0)),
        Case("AUTO in mid upload", loss, Misbehaviour(mission_mode_at_item=item)),
        Case("silence in mid upload", loss, Misbehaviour(silent_at_item=item)),
        Case("an item that is refused", loss, Misbehaviour(refuses_command=206)),
        Case("wrong echoes", loss, Misbehaviour(wrong_echoes=int(rng.integers(1, 6)))),
        Case("items kept wrong", loss, Misbehaviour(keeps_wrong=int(rng.integers(1, 6)))),
        Case("stopped by the user", loss, Misbehaviour(), stop_s=float(rng.uniform(0.0, 120.0))),
    ]


def over_udp(autopilot: Autopilot, loss: float, seed: int) -> Report:
    """Upload 60 items over a real socket to a vehicle in its own process."""
    options = [f"--autopilot={autopilot}", "--link=udp", "--port=0", f"--loss={loss}", f"--seed={seed}"]
    with subprocess.Popen(
        [sys.executable, "-m", "photomap_gis.simulate.vehicle", *options],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2],
    ) as process:  # fmt: skip
        assert process.stdout is not None and process.stdin is not None
        port = json.loads(process.stdout.readline())["port"]
        report = run(Connection(f"udpout:127.0.0.1:{port}"), lambda talk: steps(talk, survey(60)))
        process.stdin.close()
    return report


def main() -> int:
    """Print the tables; return 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description="Uploads over bad links.")
    parser.add_argument("--runs", type=int, default=200, help="for each loss and autopilot")
    parser.add_argument("--fault-runs", type=int, default=20, help="for each fault and autopilot")
    parser.add_argument("--real", type=int, default=1, help="over real UDP, for each autopilot")
    arguments = parser.parse_args()
    broken = False
    print(f"{ITEMS} items, a fence and a rally point; the vehicle holds another mission; simulated time\n")
    print(f"{'autopilot':10} {'loss':>5} {'runs':>5} {'verified':>9} {'false':>6} {'median s':>9} {'95 % s':>8}")
    for loss in (0.0, 0.1, 0.2, 0.3, 0.4):
        for autopilot in Autopilot:
            case = Case("loss", Weather(loss=loss), Misbehaviour())
            results = [upload_once(autopilot, case, seed) for seed in range(arguments.runs)]
            share = sum(r.outcome == "verified" for r, _ in results) / len(results)
            false = sum(f for _, f in results)
            seconds = [r.seconds for r, _ in results]
            print(f"{autopilot:10} {loss:5.0%} {len(results):5} {share:9.2%} {false:6} {np.median(seconds):9.0f} "
                  f"{np.quantile(seconds, 0.95):8.0f}")  # fmt: skip
            broken |= false > 0 or share < LIMITS.get(loss, 0.0)
    print(f"\n{'autopilot':10} {'fault':32} {'runs':>5} {'false':>6}  outcomes")
    names = [case.name for case in cases(0)]
    for number, name in enumerate(names):
        for autopilot in Autopilot:
            results = [upload_once(autopilot, cases(s)[number], s) for s in range(arguments.fault_runs)]
            false = sum(f for _, f in results)
            outcomes = Counter(str(r.outcome) for r, _ in results)
            told = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
            print(f"{autopilot:10} {name:32} {len(results):5} {false:6}  {told}")
            broken |= false > 0
    for autopilot in Autopilot:
        for seed in range(arguments.real):
            report = over_udp(autopilot, 0.2, seed)
            print(f"\n{autopilot}: 60 items over real UDP at 20 % loss: {report.outcome} in {report.seconds:.0f} s")
            broken |= report.outcome != "verified"
    print("\na limit is broken" if broken else "\nall limits hold")
    return int(broken)


if __name__ == "__main__":
    sys.exit(main())
