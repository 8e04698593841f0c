"""Error frames, told from the picture, its predecessor and their registration."""

from photomap_gis.ifmi.frames.judge import judge_frame
from photomap_gis.ifmi.frames.look import FrameLook, look_at
from photomap_gis.ifmi.frames.overlay import fixed_overlay_mask
from photomap_gis.ifmi.frames.registered import judge_registered
from photomap_gis.ifmi.frames.verdict import Fault, FrameVerdict

__all__ = [
    "Fault",
    "FrameLook",
    "FrameVerdict",
    "fixed_overlay_mask",
    "judge_frame",
    "judge_registered",
    "look_at",
]
