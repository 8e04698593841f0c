"""The flight planner's dock: draw an area, see the flights, save and upload them."""
