"""The server's fake flights in a process of its own, for checks in QGIS: driven by lines on stdin, each answered.

``new FOLDER TOKEN [relative]``, then ``step N``, ``solve``, ``snap``, ``lose``, ``again``, ``progress SHARE``,
``down``, ``up``, ``ask`` (what it knows).
"""

from __future__ import annotations

import functools
import json
import sys
from contextlib import ExitStack
from pathlib import Path

from tests.server import live_fake
from tests.server.live_served import live_server

live_fake.procedural_scene = functools.cache(live_fake.procedural_scene)  # the same ground for every flight


def main() -> None:
    """Serve until stdin closes."""
    with ExitStack() as stack:
        for line in sys.stdin:
            word, *rest = line.split()
            if word == "new":
                stack.close()
                session = live_fake.FakeSession(Path(rest[0]), georeferenced=rest[2:] != ["relative"])
                session.step(40)
                token = rest[1]
                served = stack.enter_context(live_server(session, token=token))
                port = int(served.url.rstrip("/").rpartition(":")[2])
                _say(url=f"{served.url}?token={token}")
                continue
            if word == "step":
                session.step(int(rest[0]))
            elif word == "progress":
                session.progress(float(rest[0]))
            elif word in ("solve", "snap", "lose"):
                getattr(session, word)()
            elif word == "again":
                session.find_again()
            elif word == "down":
                stack.close()
            elif word == "up":
                stack.enter_context(live_server(session, port=port, token=token))
            vehicle = session.state.pose.vehicle
            _say(
                version=session.version,
                finalised=session.finalised,
                lon_lat=None if vehicle is None else [vehicle.lon_deg, vehicle.lat_deg],
            )


def _say(**words: object) -> None:
    print(json.dumps(words), flush=True)


if __name__ == "__main__":
    main()
