"""Missions to and from an autopilot by MAVLink: uploaded, read back, compared, restored."""
