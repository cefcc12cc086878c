"""The web server of the page: bound where it is told, to the port it is told, open to its own pages only."""

from __future__ import annotations

import ipaddress
import logging
import socket
import warnings
from urllib.parse import urlsplit

import rich
import viser
from viser.infra import WebsockClientConnection

from common.config import ConfigError
from ground.console.config import ConsoleConfig

log = logging.getLogger(__name__)


class PageServer(viser.ViserServer):
    """A viser server that never opens a tunnel to the internet, which its library offers to every browser."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: whoever had that address could fly the vehicle."""
        log.warning("a browser asked for a public address of this console: refused")
        return None


def open_server(config: ConsoleConfig, label: str) -> PageServer:
    """Running server on the configured address.

    Args:
        config: host and port.
        label: title of the panel.

    Raises:
        ConfigError: the address is not one of this machine, or the port is taken.
    """
    _probe(config.host, config.port)
    # A port that is opened and closed again (a health check) would be worth a traceback to this logger.
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    # The library prints a frame around the address and a farewell; our log says it in one line each.
    rich.get_console().quiet = True
    # A browser that leaves while its picture is being drawn is no fault.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
    server = PageServer(host=config.host, port=config.port, label=label, verbose=False)
    if server.get_port() != config.port:  # it moves on to the next port by itself
        server.stop()
        raise ConfigError(_taken(config.host, config.port))
    _refuse_foreign_pages(server, loopback_only=_is_loopback(config.host))
    log.info("console on http://%s:%d", "localhost" if _is_loopback(config.host) else config.host, config.port)
    if not _is_loopback(config.host):
        log.warning(
            "the console has no password, and whoever reaches %s:%d can fly the vehicle", config.host, config.port
        )
    return server


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


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def may_connect(origin: str | None, host: str | None, loopback_only: bool) -> bool:
    """Whether a websocket comes from a page that this server itself delivered.

    A page of any web site that the operator has open could otherwise connect to a console on the same machine and
    command the vehicle: browsers let websockets cross origins, and a name server can point any name to 127.0.0.1.

    Args:
        origin: `Origin` header; absent from programs that are no browsers.
        host: `Host` header.
        loopback_only: whether the server is bound to this machine alone.
    """
    if origin is None:
        return True
    page = urlsplit(origin)
    if host is None or page.netloc != host:
        return False
    return not loopback_only or page.hostname in ("localhost", "127.0.0.1", "::1")


def _refuse_foreign_pages(server: PageServer, loopback_only: bool) -> None:
    # The library has no such check and no public hook for one. This callback runs before it reads a client's first
    # message; its connection object is found where the library keeps it.
    websockets = server._websock_server

    async def check(client: WebsockClientConnection) -> None:
        connection = websockets._live_connections[client.client_id]
        headers = connection.request.headers if connection.request is not None else {}
        if not may_connect(headers.get("Origin"), headers.get("Host"), loopback_only):
            log.warning("refused a page from %s", headers.get("Origin"))
            await connection.close(1008, "this page was not delivered by this console")

    websockets.on_client_connect(check)
