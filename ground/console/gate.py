"""Who may see and use the console: origin of the page, password, sessions, and a limit on failed tries."""

from __future__ import annotations

import asyncio
import base64
import binascii
import hmac
import ipaddress
import logging
import secrets
import time
from collections import OrderedDict
from collections.abc import Iterable
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ground.console import login
from ground.console.password import PasswordHash

log = logging.getLogger(__name__)

SESSION_S = 24 * 3600
"""How long a login lasts, s."""
_FREE_TRIES = 3
_LONGEST_WAIT_S = 60.0
_FORGET_S = 900.0
_ADDRESSES = 1024


def may_connect(origin: str | None, host: str | None, loopback_only: bool, origins: Iterable[str] = ()) -> bool:
    """Whether a websocket comes from a page that this server itself delivered.

    A page of any web site that the operator has open could otherwise connect to a console on the same machine and
    command the vehicle: browsers let websockets cross origins, and a name server can point any name to 127.0.0.1.

    Args:
        origin: `Origin` header; absent from programs that are no browsers.
        host: `Host` header.
        loopback_only: whether the server is bound to this machine alone.
        origins: further origins that may, such as a reverse proxy's.
    """
    if origin is None or origin in origins:
        return True
    page = urlsplit(origin)
    if host is None or page.netloc != host:
        return False
    return not loopback_only or page.hostname in ("localhost", "127.0.0.1", "::1")


class TryLimit:
    """Slows down who guesses: after three failed tries an address waits 1 s, then 2 s, 4 s … 60 s before the next."""

    def __init__(self) -> None:
        self._failed: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait_s(self, address: str, now_s: float) -> float:
        """How long this address has to wait before it may try again, s; 0 for now."""
        count, last_s = self._failed.get(_network(address), (0, 0.0))
        if count < _FREE_TRIES:
            return 0.0
        return max(0.0, last_s + min(2.0 ** min(count - _FREE_TRIES, 10), _LONGEST_WAIT_S) - now_s)

    def failed(self, address: str, now_s: float) -> int:
        """Note a failed try; returns how many there were from this address lately."""
        network = _network(address)
        count, last_s = self._failed.pop(network, (0, now_s))
        count = 1 if now_s - last_s > _FORGET_S else count + 1
        self._failed[network] = (count, now_s)
        while len(self._failed) > _ADDRESSES:
            self._failed.popitem(last=False)
        return count

    def passed(self, address: str) -> None:
        """Forget the failed tries of an address."""
        self._failed.pop(_network(address), None)


def _network(address: str) -> str:
    """What counts as one address: an IPv4 address, or an IPv6 /64, which one machine can use as it likes."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if ip.version == 6:
        return str(ip.ipv4_mapped or ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)


class Sessions:
    """Makes and checks the tokens that a browser keeps after the password: expiry, nonce and signature.

    Args:
        key: signs them.
    """

    def __init__(self, key: bytes):
        self._key = key

    def token(self, now_s: float) -> str:
        """A new token. `now_s` is Unix time, s: it has to outlive a restart."""
        body = f"{int(now_s + SESSION_S)}.{secrets.token_hex(8)}"
        return f"{body}.{self._signature(body)}"

    def valid(self, token: str, now_s: float) -> bool:
        """Whether a token is one of ours and has not expired."""
        body, _, signature = token.rpartition(".")
        if not hmac.compare_digest(signature.encode("utf-8", "replace"), self._signature(body).encode()):
            return False
        return now_s < int(body.partition(".")[0])

    def _signature(self, body: str) -> str:
        return hmac.digest(self._key, body.encode("utf-8", "replace"), "sha256").hex()


class Gate:
    """Decides about each request, the websocket handshake included, before the library behind it sees it.

    Args:
        password: hash; None lets everybody in whose page is right, which is for loopback alone.
        loopback_only: whether the server is bound to this machine alone.
        origins: further origins that may connect.
        port: part of the cookie's name, since browsers share cookies among the ports of a host.
        tls: whether the page comes over TLS.
    """

    def __init__(
        self, password: PasswordHash | None, loopback_only: bool, origins: tuple[str, ...], port: int, tls: bool
    ):
        self._password = password
        self._loopback_only = loopback_only
        self._origins = origins
        self._cookie = f"outrider-console-{port}"
        self._tls = tls
        self._sessions = Sessions(password.session_key() if password else secrets.token_bytes(32))
        self._limit = TryLimit()
        self._one_at_a_time = asyncio.Lock()

    async def refuse(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer that ends this request here, or None when it may go on."""
        headers = request.headers
        address = str((connection.remote_address or ("unknown",))[0])
        path = request.path.partition("?")[0]
        if "Upgrade" in headers or path == login.PATH:
            origin = headers.get("Origin")
            if not may_connect(origin, headers.get("Host"), self._loopback_only, self._origins):
                log.warning("refused a page from %s (address %s)", origin, address)
                return _text(HTTPStatus.FORBIDDEN, "This page was not delivered by this console.")
        if self._password is None or (path != login.PATH and self._has_session(headers)):
            return None
        if (given := _basic(headers)) is not None:
            return await self._try(self._password, given, address, path)
        if "Upgrade" in headers or path == login.PATH:
            return _text(HTTPStatus.UNAUTHORIZED, "The console needs its password.")
        if path != "/":
            return _text(HTTPStatus.UNAUTHORIZED, "The console needs its password: open its first page.")
        more = {"Content-Security-Policy": login.POLICY}
        return _answer(HTTPStatus.UNAUTHORIZED, "text/html; charset=utf-8", login.PAGE, more)

    async def _try(self, kept: PasswordHash, given: str, address: str, path: str) -> Response | None:
        async with self._one_at_a_time:  # whoever guesses takes one core at most, and no try slips past the limit
            if (wait_s := self._limit.wait_s(address, time.monotonic())) > 0:
                text = f"Too many wrong passwords from {address}: wait {wait_s:.0f} s."
                return _text(HTTPStatus.TOO_MANY_REQUESTS, text, {"Retry-After": str(int(wait_s) + 1)})
            if not await asyncio.to_thread(kept.matches, given):
                count = self._limit.failed(address, time.monotonic())
                log.warning("wrong password from %s, %d lately", address, count)
                return _text(HTTPStatus.UNAUTHORIZED, "Wrong password.")
            self._limit.passed(address)
        if path != login.PATH:
            return None
        log.info("login from %s", address)
        cookie = f"{self._cookie}={self._sessions.token(time.time())}; Path=/; Max-Age={SESSION_S}"
        cookie += "; HttpOnly; SameSite=Strict" + ("; Secure" if self._tls else "")
        return _text(HTTPStatus.OK, "Welcome.", {"Set-Cookie": cookie})

    def _has_session(self, headers: Headers) -> bool:
        for text in headers.get_all("Cookie"):
            try:
                morsel = SimpleCookie(text).get(self._cookie)
            except CookieError:
                continue
            if morsel is not None and self._sessions.valid(morsel.value, time.time()):
                return True
        return False


def _basic(headers: Headers) -> str | None:
    """Password of HTTP basic credentials (RFC 7617); the user's name does not matter. None without any."""
    given = headers.get_all("Authorization")
    if not given:
        return None
    scheme, _, encoded = given[0].partition(" ")
    try:
        _user, _, password = base64.b64decode(encoded, validate=True).decode("utf-8").partition(":")
    except (binascii.Error, UnicodeDecodeError, ValueError):
        return ""
    return password if scheme.lower() == "basic" else ""


def _text(status: HTTPStatus, text: str, more: dict[str, str] | None = None) -> Response:
    return _answer(status, "text/plain; charset=utf-8", text, more or {})


def _answer(status: HTTPStatus, kind: str, text: str, more: dict[str, str]) -> Response:
    body = text.encode()
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store"})
    headers.update({"Connection": "close", **more})
    return Response(status.value, status.phrase, headers, body)
