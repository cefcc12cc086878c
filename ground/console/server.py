"""The web server of the page: bound where it is told, to the port it is told, with the gate before every request."""

from __future__ import annotations

import logging
import socket
import ssl
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from inspect import isawaitable
from typing import Any, Protocol

import rich
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from common.config import ConfigError
from ground.console.config import ConsoleConfig, is_loopback
from ground.console.gate import Gate
from ground.console.password import read_hash

log = logging.getLogger(__name__)


class PageServer(viser.ViserServer):
    """A viser server that never opens a tunnel to the internet, which its library offers to every browser."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: whoever had that address could fly the vehicle."""
        log.warning("a browser asked for a public address of this console: refused")
        return None


class OwnPage(Protocol):
    """A page of ours beside the library's, with a socket at the same address."""

    path: str
    """Its address."""
    frames: str
    """Which pages may frame it (`X-Frame-Options`)."""

    def page(self) -> Response:
        """The page."""
        ...

    async def talk(self, connection: ServerConnection) -> None:
        """Serve one socket until it closes; runs in the server's thread."""
        ...


def open_server(config: ConsoleConfig, label: str, own: Sequence[OwnPage] = ()) -> PageServer:
    """Running server on the configured address.

    Args:
        config: host and port.
        label: title of the panel.
        own: further pages, behind the same gate.

    Raises:
        ConfigError: the address is not one of this machine, the port is taken, or the password file or the
            certificate cannot be used.
    """
    open_to_others = not is_loopback(config.host)
    password = read_hash(config.password_file) if config.password_file else None
    tls = _tls(config)
    gate = Gate(password, not open_to_others, config.origins, config.port, tls is not None)
    _probe(config.host, config.port)
    # A port that is opened and closed again (a health check) would be worth a traceback to this logger.
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    # The library prints a frame around the address and a farewell; our log says it in one line each.
    rich.get_console().quiet = True
    # A browser that leaves while its picture is being drawn is no fault.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
    with _gate_before_every_request(gate, tls, {page.path: page for page in own}):
        server = PageServer(host=config.host, port=config.port, label=label, verbose=False)
    if server.get_port() != config.port:  # it moves on to the next port by itself
        server.stop()
        raise ConfigError(_taken(config.host, config.port))
    scheme = "http" if tls is None else "https"
    log.info("console on %s://%s:%d", scheme, config.host if open_to_others else "localhost", config.port)
    if open_to_others and tls is None:
        log.warning(
            "the console's password and pages cross the network unencrypted; set console.tls_certificate and "
            "console.tls_key, or put a reverse proxy with TLS before a console on 127.0.0.1"
        )
    return server


@contextmanager
def _gate_before_every_request(gate: Gate, tls: ssl.SSLContext | None, own: Mapping[str, OwnPage]) -> Iterator[None]:
    """While it lasts, a server that the library opens asks the gate first, speaks TLS, and has our own pages as well.

    The library has no hook for any of it: it hands its own `process_request` to `websockets.asyncio.server.serve`,
    which it looks up at the moment of opening. This is the one place that relies on it.

    Raises:
        ConfigError: this version of viser opened its server in another way, which would leave the console open.
    """
    serve: Callable[..., Any] = websockets.asyncio.server.serve
    guarded = False

    def open_guarded(
        handler: Callable[..., Any], *arguments: Any, process_request: Callable[..., Any], **options: Any
    ) -> Any:
        nonlocal guarded

        async def ask_first(connection: ServerConnection, request: Request) -> Response | None:
            answer = await gate.refuse(connection, request)
            page = own.get(_path(request))
            if answer is None and page is not None and "Upgrade" not in request.headers:
                answer = page.page()
            elif answer is None and page is None:
                answer = process_request(connection, request)
                answer = await answer if isawaitable(answer) else answer
            if answer is not None:  # no other page may lay itself over the buttons
                answer.headers["X-Frame-Options"] = "DENY" if page is None else page.frames
            return answer

        async def talk(connection: ServerConnection) -> None:
            page = None if connection.request is None else own.get(_path(connection.request))
            await (handler if page is None else page.talk)(connection)

        guarded = True
        return serve(talk, *arguments, process_request=ask_first, ssl=tls, **options)

    websockets.asyncio.server.serve = open_guarded  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[assignment,misc]
    if not guarded:
        raise ConfigError(
            f"console: viser {viser.__version__} opens its server in a way that Outrider does not know, so nothing "
            f"would check who connects; install viser 1.1"
        )


def _path(request: Request) -> str:
    return request.path.partition("?")[0]


def _tls(config: ConsoleConfig) -> ssl.SSLContext | None:
    if not config.tls_certificate:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # An empty password: a key that has one fails here instead of asking at a terminal that nobody watches.
        context.load_cert_chain(config.tls_certificate, config.tls_key, password="")
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"console.tls_certificate, console.tls_key: {config.tls_certificate!r} and {config.tls_key!r} cannot be "
            f"used ({error}); expected PEM files of one certificate and its key, without a password"
        ) from None
    return context


def _probe(host: str, port: int) -> None:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise ConfigError(
            f"console.host: got {host!r}, which is no address ({error}); expected one of this machine, "
            f"such as 127.0.0.1"
        ) from None
    with socket.socket(family, kind, protocol) as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind(address)
            trial.listen(1)
        except PermissionError:
            raise ConfigError(f"console.port: got {port}, which only root may use; expected one above 1023") from None
        except OSError as error:
            if error.errno == 98:  # EADDRINUSE
                raise ConfigError(_taken(host, port)) from None
            raise ConfigError(
                f"console.host: cannot listen on {host!r} ({error.strerror}); expected an address of "
                f"this machine, such as 127.0.0.1"
            ) from None


def _taken(host: str, port: int) -> str:
    return (
        f"console.port: {port} on {host} is taken, by another console or another program; stop it, or choose "
        f"another port with --set console.port={port + 1}"
    )
