"""A real mouse: events that the X server itself makes (XTEST), so that they take the way of a hand's."""

from __future__ import annotations

import ctypes

LEFT, MIDDLE, RIGHT = 1, 2, 3


class Mouse:
    """The pointer of a display; places are pixels of the whole screen."""

    def __init__(self) -> None:
        self._x11 = ctypes.CDLL("libX11.so.6")
        self._xtst = ctypes.CDLL("libXtst.so.6")
        self._x11.XOpenDisplay.restype = ctypes.c_void_p
        self._x11.XFlush.argtypes = [ctypes.c_void_p]
        self._xtst.XTestFakeMotionEvent.argtypes = [ctypes.c_void_p, *[ctypes.c_int] * 3, ctypes.c_ulong]
        self._xtst.XTestFakeButtonEvent.argtypes = [ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_ulong]
        self._display = self._x11.XOpenDisplay(None)
        if not self._display:
            raise RuntimeError("there is no X display")

    def move(self, x: int, y: int) -> None:
        """Move the pointer there."""
        self._xtst.XTestFakeMotionEvent(self._display, -1, x, y, 0)
        self._x11.XFlush(self._display)

    def press(self, button: int = LEFT) -> None:
        """Press a button where the pointer is."""
        self._xtst.XTestFakeButtonEvent(self._display, button, 1, 0)
        self._x11.XFlush(self._display)

    def release(self, button: int = LEFT) -> None:
        """Let it go."""
        self._xtst.XTestFakeButtonEvent(self._display, button, 0, 0)
        self._x11.XFlush(self._display)

    def click(self, x: int, y: int, button: int = LEFT) -> None:
        """Click there."""
        self.move(x, y)
        self.press(button)
        self.release(button)
