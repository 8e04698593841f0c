"""Packets of a damaged container: what can still be had, without end and without falling over."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

from av.error import FFmpegError

logger = logging.getLogger(__name__)

_MAX_ERRORS_IN_A_ROW = 50


def packets(container: Any, streams: Any) -> Iterator[Any]:
    """Yield the packets of one or several streams; after an error the reading goes on behind it.

    PyAV raises ``IndexError`` for a stream that a damaged file seems to begin midway, FFmpeg any of its errors.
    """
    errors = 0
    while errors < _MAX_ERRORS_IN_A_ROW:
        try:
            for packet in container.demux(streams):
                errors = 0
                yield packet
            return
        except (FFmpegError, IndexError) as error:
            errors += 1
            logger.info("%s: reads on after %s", container.name, error)
    logger.warning("%s: given up after %d errors in a row", container.name, errors)
