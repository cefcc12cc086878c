"""The stick's own page and socket on the console's server: behind the same gate as everything else there."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import time
from http import HTTPStatus

from websockets import ConnectionClosed
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Response

from ground.console import stick_page
from ground.console.stick import Stick, StickError, read_stand

log = logging.getLogger(__name__)

_BEAT_S = 0.1
_LONGEST_TEXT = 400
_POLICY_VIOLATION = 1008


class StickLink:
    """Delivers the stick's page, and talks with it.

    Args:
        stick: where the pages' sticks come together.
    """

    path = stick_page.PATH
    frames = "SAMEORIGIN"
    """Which pages may frame this one (`X-Frame-Options`)."""

    def __init__(self, stick: Stick):
        self._stick = stick
        self.helm = ""
        """What helm makes of the stick, in words for the operator."""

    def page(self) -> Response:
        """The page."""
        body = stick_page.PAGE.encode()
        headers = Headers(
            {
                "Content-Type": "text/html; charset=utf-8",
                "Content-Length": str(len(body)),
                "Cache-Control": "no-store",
                "Content-Security-Policy": stick_page.POLICY,
            }
        )
        return Response(HTTPStatus.OK.value, HTTPStatus.OK.phrase, headers, body)

    async def talk(self, connection: ServerConnection) -> None:
        """Take one page's stick until it goes; a page that sends anything else is shown the door."""
        number = self._stick.join()
        log.info("stick taken by page %d", number)
        teller = asyncio.create_task(self._tell(connection, number))
        try:
            async for text in connection:
                if len(text) > _LONGEST_TEXT:
                    raise StickError(f"stick: got {len(text)} bytes, expected at most {_LONGEST_TEXT}")
                self._stick.move(number, read_stand(text), time.monotonic_ns())
        except ConnectionClosed:
            pass
        except StickError as error:
            log.warning("%s: refused", error)
            await connection.close(_POLICY_VIOLATION, str(error)[:100])
        finally:
            self._stick.leave(number)
            log.info("stick let go by page %d", number)
            teller.cancel()

    async def _tell(self, connection: ServerConnection, number: int) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                t_ns = time.monotonic_ns()
                say = self._stick.note(number, t_ns) or self.helm
                await connection.send(json.dumps({"beat": t_ns // 1_000_000, "say": say}))
                await asyncio.sleep(_BEAT_S)
