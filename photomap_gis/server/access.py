"""Who may ask: programs of this machine only, or those that hold the token.

A web page from elsewhere must not read a map off this machine: a name that points at 127.0.0.1 (DNS rebinding) is
turned away by its Host header, and no answer carries a CORS header.
"""

from __future__ import annotations

import ipaddress
import secrets
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode

from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from photomap_gis.server.protocol import ErrorDocument

_LOCAL_NAMES = {"localhost"}
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"SAMEORIGIN"),
)


def new_token() -> str:
    """Return a fresh secret that can stand in a URL."""
    return secrets.token_urlsafe(24)


def is_loopback(host: str) -> bool:
    """Whether a host name or address is this machine's loopback."""
    name = host.strip("[]").rstrip(".").lower()
    if name in _LOCAL_NAMES:
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Access:
    """The rules: ``token`` is asked for where it is not ``None``; ``loopback_only`` turns other Host names away.

    ``cookie`` lets a browser that came with the token in its address keep it. Writing is for those who hold the token
    (or ``write_token``, for programs that need none to read), and for this server's own page.
    """

    token: str | None
    loopback_only: bool
    cookie: str = "photomap"
    write_token: str | None = None


class AccessMiddleware:
    """Turns away whoever may not ask, before anything is read."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        refusal = self._refusal(scope, headers)

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message["headers"], *_HEADERS]}
            await send(message)

        await (refusal or self._app)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> Response | None:
        access = self._access
        if access.loopback_only and not is_loopback(_host_name(headers.get("host", ""))):
            return problem(403, "forbidden", "this server answers to localhost only: use the address that it printed")
        writes = scope["method"] not in ("GET", "HEAD", "OPTIONS")
        if access.token is None and not writes:
            return None
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        given = next((v for k, v in query if k == "token"), None)
        bearer = headers.get("authorization", "")
        if given is None and bearer[:7].lower() == "bearer ":
            given = bearer[7:].strip()
        if given is not None and any(_same(given, t) for t in (access.token, access.write_token if writes else None)):
            if access.token is not None and scope["path"] == "/" and scope["method"] == "GET":
                return self._welcome([(k, v) for k, v in query if k != "token"])
            return None
        known = access.token is None or (given is None and self._has_cookie(headers.get("cookie", "")))
        if known and not writes:
            return None
        if known:
            if not _is_our_page(headers):
                return problem(403, "origin", "writing is for this server's own page and for those who show the token")
            if scope["method"] != "DELETE" and not _is_json(headers.get("content-type", "")):
                return problem(415, "json", "what a page writes is JSON: send content-type: application/json")
            return None
        return problem(401, "token", "a token is needed: open the address with ?token=... that the server printed")

    def _welcome(self, rest: list[tuple[str, str]]) -> Response:
        """Take the token out of the browser's address bar and history, into a cookie that scripts cannot read."""
        response = RedirectResponse("/" + (f"?{urlencode(rest)}" if rest else ""), status_code=303)
        response.set_cookie(self._access.cookie, self._access.token or "", httponly=True, samesite="strict")
        return response

    def _has_cookie(self, text: str) -> bool:
        try:
            kept = SimpleCookie(text).get(self._access.cookie)
        except CookieError:
            return False
        return kept is not None and secrets.compare_digest(kept.value.encode(), (self._access.token or "").encode())


def _same(given: str, token: str | None) -> bool:
    return token is not None and secrets.compare_digest(given.encode(), token.encode())


def _is_json(content_type: str) -> bool:
    return content_type.partition(";")[0].strip().lower() == "application/json"


def _is_our_page(headers: dict[str, str]) -> bool:
    """Whether a request that writes comes from a page of this server.

    Browsers send ``Origin`` with every such request and let no page forge it; another page's JSON would besides need
    leave that no answer of ours gives (CORS).
    """
    origin, host = headers.get("origin", ""), headers.get("host", "")
    same = origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}") and host != ""
    return same and headers.get("sec-fetch-site", "same-origin") in ("same-origin", "none")


def problem(status: int, error: str, message: str) -> Response:
    """Return an ``ErrorDocument``."""
    return JSONResponse(ErrorDocument(error=error, message=message).model_dump(), status_code=status)


def _host_name(host: str) -> str:
    if host.startswith("["):
        return host.partition("]")[0]
    return host.partition(":")[0]
