"""photomap: from a drone's video or photos to a georeferenced photo map.

``register_images`` is loaded on first use, so that importing the package stays cheap.
"""

from typing import Any

__all__ = ["__version__", "register_images"]

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name == "register_images":
        from photomap_gis.ifmi import register_images

        return register_images
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
