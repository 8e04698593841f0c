"""How good maps of change are: pairs of pictures whose changes are known."""
