"""The page of a flight in a real Chromium, as a process of its own: ``python -m benchmarks.live.browser URL DIR``.

It opens the page, tells on its last line what the page saw and when (JSON), and leaves screenshots in DIR. It ends when
its standard input does. Times are of the machine's clock, in seconds since 1970.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip
DESKTOP, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
HARVEST_S = 1.0
FOLLOW_AT = 0.3
"""From this share of the flight on the drone is followed close up; before, the page shows all of the map."""
PICTURES = (("start", 0.04), ("mid", 0.5), ("phone", 0.6), ("after-loop", 0.85))
"""Screenshots, and at which share of the flight."""
PHONE_S = 6.0

_LISTEN = """
window.told = {poses: [], tiles: [], views: []};
const now = () => (performance.timeOrigin + performance.now()) / 1000;
const Source = window.EventSource;
window.EventSource = class extends Source {
  constructor(...all) {
    super(...all);
    this.addEventListener("pose", e => told.poses.push([JSON.parse(e.data).frame, now()]));
  }
};
setInterval(() => {
  if (typeof photomap === "undefined") return;
  const live = photomap.rasters?.get("map")?.live, view = photomap.live?.view;
  if (live && !live.isTold) {
    live.isTold = true;
    const show = live.show.bind(live);
    live.show = (entry, picture) => {
      show(entry, picture);
      const place = entry.tile.getTileCoord(), etag = entry.etag;
      // After the second frame from now the first one, with the tile in it, has been painted.
      requestAnimationFrame(() => requestAnimationFrame(() => told.tiles.push([...place, etag, now()])));
    };
  }
  if (view && !view.isTold) {
    view.isTold = true;
    const draw = view.draw.bind(view);
    view.draw = async answer => { await draw(answer); told.views.push(now()); };
  }
}, 100);
"""
_FOLLOW = """() => {
  const view = photomap.map.getView(), drone = photomap.live.state.pose?.drone;
  photomap.live.moved = true;
  if (drone) view.setCenter(photomap.at(drone));
  view.setResolution(0.3);
  photomap.live.follow(true);
}"""


@dataclass(slots=True)
class Seen:
    """What a page has seen: poses (frame, when), tiles painted (zoom, x, y, ETag, when), stabilised views (when)."""

    poses: list[tuple[int, float]] = field(default_factory=list)
    tiles: list[tuple[int, int, int, str, float]] = field(default_factory=list)
    views: list[float] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


class Watching:
    """The process from outside (a context manager): it looks on while the flight lasts; ``seen`` is there afterwards.

    ``chromium_cpu_s`` is the processor time of the browser's processes, its driver left out.
    """

    def __init__(self, url: str, folder: Path, seconds: float) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._log = (folder / "browser.log").open("w", encoding="utf-8")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.live.browser", url, str(folder), str(seconds)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True,
        )  # fmt: skip
        self.seen = Seen()
        self._used: dict[int, float] = {}
        self._ended = threading.Event()
        self._counter = threading.Thread(target=self._count, daemon=True)

    def __enter__(self) -> Self:
        assert self._process.stdout is not None
        if self._process.stdout.readline().strip() != "ready":
            raise RuntimeError(f"the browser did not open the page: see {self._log.name}")
        self._counter.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._counter.join(timeout=10.0)
        out, _ = self._process.communicate(timeout=120.0)
        self._log.close()
        if out.strip():
            self.seen = Seen(**json.loads(out.splitlines()[-1]))

    @property
    def chromium_cpu_s(self) -> float:
        """Seconds of processor time since the page was open."""
        return sum(self._used.values())

    def _count(self) -> None:
        begun: dict[int, float] | None = None
        while not self._ended.wait(1.0):
            now = _chromium_cpu_s(self._process.pid)
            begun = now if begun is None else begun
            self._used.update({pid: used - begun.get(pid, 0.0) for pid, used in now.items()})


def _chromium_cpu_s(root: int) -> dict[int, float]:
    """Return the processor time of each process below one, by what the kernel tells."""
    parents: dict[int, tuple[int, str, float]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            head, _, tail = stat.read_text(encoding="ascii", errors="replace").rpartition(")")
        except OSError:
            continue
        fields = tail.split()
        used_s = (int(fields[11]) + int(fields[12])) / 100.0
        parents[int(stat.parent.name)] = (int(fields[1]), head.partition("(")[2], used_s)
    mine, before = {root}, 0
    while len(mine) > before:
        before = len(mine)
        mine |= {pid for pid, (parent, _, _) in parents.items() if parent in mine}
    return {pid: used for pid, (_, name, used) in parents.items() if pid in mine and name.startswith("chrom")}


def look_on(url: str, folder: Path, seconds: float) -> Seen:
    """Open the page, say that it is ready, look on until the standard input ends; return what was seen."""
    from playwright.sync_api import sync_playwright

    executable = shutil.which("chromium") or shutil.which("chromium-browser")
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    seen = Seen()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=list(FLAGS))
        page = browser.new_page(viewport=DESKTOP)  # type: ignore[arg-type]
        page.add_init_script(_LISTEN)
        page.on("pageerror", lambda error: seen.errors.append(str(error)))
        page.goto(url)
        page.wait_for_selector("body[data-ready]")
        print("ready", flush=True)
        began, pictures, follows = time.monotonic(), list(PICTURES), False
        while not ended.wait(HARVEST_S):
            share = (time.monotonic() - began) / seconds
            _harvest(page, seen)
            if share >= FOLLOW_AT and not follows:
                follows = True
                _try(lambda: page.evaluate(_FOLLOW), seen)
            if pictures and share >= pictures[0][1]:
                name, _ = pictures.pop(0)
                if name == "phone":
                    _try(lambda: _phone(browser, url, folder), seen)
                else:
                    _try(lambda name=name: page.screenshot(path=str(folder / f"{name}.png")), seen)
        _harvest(page, seen)
        _try(lambda: page.screenshot(path=str(folder / "end.png")), seen)
        browser.close()
    return seen


def _harvest(page: Any, seen: Seen) -> None:
    def take() -> None:
        told = page.evaluate(
            "() => { const t = window.told; window.told = {poses: [], tiles: [], views: []}; return t; }"
        )
        seen.poses += told["poses"]
        seen.tiles += told["tiles"]
        seen.views += told["views"]

    _try(take, seen)


def _phone(browser: Any, url: str, folder: Path) -> None:
    context = browser.new_context(viewport=PHONE, device_scale_factor=2, is_mobile=True, has_touch=True)
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector("body[data-ready]")
    page.wait_for_timeout(1000.0 * PHONE_S)
    page.screenshot(path=str(folder / "phone.png"))
    context.close()


def _try(act: Any, seen: Seen) -> None:
    """Do something to a page that may be loading itself anew just now."""
    from playwright.sync_api import Error

    try:
        act()
    except Error as error:
        seen.errors.append(f"asked: {error}")


if __name__ == "__main__":
    what = look_on(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3]))
    print(json.dumps({"poses": what.poses, "tiles": what.tiles, "views": what.views, "errors": what.errors[-20:]}))
