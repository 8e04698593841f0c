"""The curve of success against CPU time, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def write_curve(path: Path, points: list[dict[str, Any]]) -> None:
    """Write a PNG of mean success over milliseconds, one line a family of methods."""
    try:
        import matplotlib  # an optional dependency
    except ImportError as error:
        raise RuntimeError("a plot needs matplotlib: pip install '.[bench]'") from error
    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 6), layout="constrained")
    families = {"iFMI": "ifmi", "ORB": "orb", "SIFT": "sift", "paper": "paper", "imreg_dft": "imreg"}
    for label, start in families.items():
        family = [p for p in points if str(p["method"]).startswith(start)]
        if family:
            x, y = [p["ms"] for p in family], [100.0 * p["success"] for p in family]
            axes.plot(x, y, "o", label=label, markersize=8 if label == "iFMI" else 5)
        for p in family:
            axes.annotate(str(p["method"]), (p["ms"], 100.0 * p["success"]), fontsize=6, xytext=(3, 3),
                          textcoords="offset points")  # fmt: skip
    axes.set_xscale("log")
    axes.set_xlabel("CPU ms: a new frame and its match with one known before")
    axes.set_ylabel("right, mean of all classes, %")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    figure.savefig(path, dpi=130)
    pyplot.close(figure)
