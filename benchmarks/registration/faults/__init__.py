"""Error frames: how many are told, and how many sound frames are lost for it."""

from benchmarks.registration.faults.measure import measure, report

__all__ = ["measure", "report"]
