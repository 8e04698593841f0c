"""Where events go: ``udp://239.2.3.1:6969`` (a team's multicast group), ``udp://``, ``tcp://`` or ``tls://HOST:PORT``."""

from __future__ import annotations

import ipaddress
import ssl
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from photomap_gis.core.errors import DataError, UsageError

TEAM_GROUP = "udp://239.2.3.1:6969"
_SCHEMES = ("udp", "tcp", "tls", "ssl")
_DEFAULT_PORT = {"udp": 6969, "tcp": 8087, "tls": 8089}
_PKCS12 = (".p12", ".pfx")


@dataclass(frozen=True, slots=True)
class Tls:
    """Who we are and whom we trust, as PEM files; ``None``: no certificate of our own, the system's authorities.

    ``server_name`` is the name in the server's certificate where that is not the host's. Verification is always on.
    """

    certificate: Path | None = None
    key: Path | None = None
    password: str | None = None
    authorities: Path | None = None
    server_name: str | None = None


@dataclass(frozen=True, slots=True)
class CotAddress:
    """A receiver; ``interface`` is the address of the network card for multicast."""

    scheme: str
    host: str
    port: int
    is_multicast: bool = False
    ttl: int = 32
    interface: str | None = None
    tls: Tls = Tls()

    @property
    def name(self) -> str:
        """The address as it is written."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def cot_address(text: str, tls: Tls | None = None) -> CotAddress:
    """Return the receiver of ``--cot``. ``UsageError`` where it is none, ``DataError`` for unusable certificates."""
    parts = urlsplit(text)
    scheme = "tls" if parts.scheme == "ssl" else parts.scheme
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        raise UsageError(f"--cot {text}: the port must be a number between 1 and 65535") from None
    if scheme not in _SCHEMES or not host or port == 0:
        raise UsageError(f"--cot {text}: write {TEAM_GROUP}, udp://HOST:PORT, tcp://HOST:PORT or tls://HOST:PORT")
    query = parse_qs(parts.query)
    ttl_text = query.get("ttl", ["32"])[0]
    if not ttl_text.isdigit() or not 0 <= int(ttl_text) <= 255:
        raise UsageError(f"--cot {text}: ttl must be a number between 0 and 255")
    interface = query.get("interface", [None])[0]
    try:
        is_multicast = ipaddress.ip_address(host).is_multicast
        if interface is not None:
            ipaddress.IPv4Address(interface)
    except ValueError as error:
        if interface is not None and "interface" in parts.query and str(interface) in str(error):
            raise UsageError(
                f"--cot {text}: interface must be the address of a network card, e.g. 192.168.1.5"
            ) from None
        is_multicast = False  # a name
    if is_multicast and scheme != "udp":
        raise UsageError(f"--cot {text}: a multicast group is reached by udp://")
    address = CotAddress(
        scheme, host, port or _DEFAULT_PORT[scheme], is_multicast, int(ttl_text), interface, tls or Tls()
    )
    if scheme == "tls":
        tls_context(address)  # certificates that cannot be used are told before the flight
    elif tls is not None and tls != Tls():
        raise UsageError(f"--cot {text}: certificates are for tls:// addresses")
    return address


def tls_context(address: CotAddress) -> ssl.SSLContext:
    """Return what a connection is made with."""
    tls = address.tls
    for path in (tls.certificate, tls.key, tls.authorities):
        if path is not None and path.suffix.lower() in _PKCS12:
            raise DataError(
                f"{path}: PKCS#12 must be unpacked first: openssl pkcs12 -in {path.name} -nodes -out {path.stem}.pem"
            )
        if path is not None and not path.is_file():
            raise DataError(f"{path}: no such file; check the path of the certificate")
    try:
        context = ssl.create_default_context(
            ssl.Purpose.SERVER_AUTH, cafile=None if tls.authorities is None else str(tls.authorities)
        )
        if tls.certificate is not None:
            # a function that is always there keeps OpenSSL from asking on the terminal
            password = tls.password or ""
            context.load_cert_chain(str(tls.certificate), None if tls.key is None else str(tls.key), lambda: password)
    except (ssl.SSLError, OSError, ValueError) as error:
        which = tls.certificate or tls.authorities
        why = getattr(error, "reason", None) or str(error)
        raise DataError(
            f"{which}: cannot be used as a certificate ({why}); give PEM files, and the key's password"
        ) from error
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context
