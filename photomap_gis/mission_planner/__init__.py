"""The mission planner: an area or a search becomes flights, and the autopilot has them, verified."""
