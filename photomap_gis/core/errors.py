"""The errors of photomap, and the exit code that each of them means on the command line.

A ``PhotomapError`` is a wrong *world* (a file, a link, a missing extra): its message is one line that says what to
do next. A wrong *argument* in code is a ``ValueError``. Low confidence is never an error: it is a number in a result.
"""


class PhotomapError(Exception):
    """The root of every error that a user can mend."""

    exit_code: int = 3


class UsageError(PhotomapError):
    """What was asked for does not make sense (exit code 2)."""

    exit_code = 2


class DataError(PhotomapError):
    """An input cannot be used (exit code 3)."""


class FrameReadError(DataError):
    """One frame cannot be read; the others can still be used."""


class NotGeoreferencedError(DataError):
    """A format or step needs a place on Earth, and the mission has none."""


class OutputError(DataError):
    """An output cannot be written (exit code 3)."""


class LinkError(PhotomapError):
    """A link or the vehicle behind it failed (exit code 4)."""

    exit_code = 4


class MissingExtraError(PhotomapError):
    """An optional package is needed; the message names the extra to install (exit code 5)."""

    exit_code = 5
