"""The address of this machine that others in the network can type."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit, urlunsplit

_SOMEWHERE = ("192.0.2.1", 9)
"""A place that nobody has (RFC 5737): to choose the way there, nothing is sent."""


def own_address() -> str | None:
    """Return the address of the card by which this machine reaches the network, ``None`` where it reaches none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        try:
            s.connect(_SOMEWHERE)
            address: str = s.getsockname()[0]
        except OSError:
            return None
    return None if address.startswith(("0.", "127.")) else address


def as_typed_elsewhere(url: str, own: str | None) -> str:
    """Return a listening address as a sender must write it: with this machine's own address for "all of them".

    >>> as_typed_elsewhere("rtmp://0.0.0.0:1935/live/drone", "192.168.1.5")
    'rtmp://192.168.1.5:1935/live/drone'
    """
    parts = urlsplit(url)
    if own is None or parts.hostname not in ("0.0.0.0", "::", None) or parts.port is None:
        return url
    return urlunsplit(parts._replace(netloc=f"{own}:{parts.port}"))
