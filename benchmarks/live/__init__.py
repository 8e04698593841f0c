"""The live session measured: in real time behind its page, and in its memory over a long flight."""
