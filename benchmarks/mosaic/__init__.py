"""How good and how fast is the drawing of a map, apart from where its frames were placed."""
