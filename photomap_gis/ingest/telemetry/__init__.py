"""Telemetry logs: one file per dialect, one kind of track."""

from photomap_gis.ingest.telemetry.read import TRACK_SUFFIXES, read_track
from photomap_gis.ingest.telemetry.track import Clock, ModeChange, Track, TrackPoint, Trigger

__all__ = ["TRACK_SUFFIXES", "Clock", "ModeChange", "Track", "TrackPoint", "Trigger", "read_track"]
