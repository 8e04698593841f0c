"""The place on Earth, measured on simulated flights with known truth."""
