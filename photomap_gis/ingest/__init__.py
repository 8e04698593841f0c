"""Reading what a drone brought home: photos, videos, telemetry."""
