"""A console's page without a browser: speaks the page's websocket, knows its elements, chooses, presses and draws."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Any

import msgspec
import viser
import zstandard
from viser import _messages as wire
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

_WIDTH_PX, _HEIGHT_PX = 640, 480
_LIVE = 5
"""Pictures after which the one that is shown is live: the page begins with a card that says that there is none."""


class ConsolePage:
    """An operator at the page of a console that runs. Its window has the shape of the picture, which fills it.

    Args:
        port: the console's.
    """

    def __init__(self, port: int):
        self._socket = connect(
            f"ws://127.0.0.1:{port}",
            origin=Origin(f"http://127.0.0.1:{port}"),
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
        )
        self._elements: dict[str, str] = {}
        self._changed = threading.Condition()
        self.pictures = 0
        """Pictures that were shown."""
        self.notes: list[str] = []
        """What the page told the operator."""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        look = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 0.01, 1000.0, _HEIGHT_PX, _WIDTH_PX)
        self._send(wire.ViewerCameraMessage(*look, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)))

    def __enter__(self) -> ConsolePage:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()
        self._reader.join(5)

    def choose(self, label: str, option: str) -> None:
        """Choose from a list."""
        self._send(wire.GuiUpdateMessage(self._element(label), {"value": option}))

    def press(self, label: str) -> None:
        """Press a button."""
        self._send(wire.GuiUpdateMessage(self._element(label), {"value": True}))

    def await_picture(self) -> None:
        """Wait until the page shows the live picture."""
        with self._changed:
            assert self._changed.wait_for(lambda: self.pictures >= _LIVE, 10), f"no picture on the page: {self.notes}"

    def draw(self, box_px: tuple[float, float, float, float]) -> None:
        """Draw a box, x, y, width, height, px, on the picture that is shown."""
        x, y, width, height = box_px
        corners = (x / _WIDTH_PX, y / _HEIGHT_PX), ((x + width) / _WIDTH_PX, (y + height) / _HEIGHT_PX)
        self._send(wire.ScenePointerMessage("rect-select", None, None, corners, None))

    def await_note(self, text: str, limit_s: float = 15.0) -> None:
        """Wait until the page tells the operator something that begins so."""
        with self._changed:
            told = self._changed.wait_for(lambda: any(note.startswith(text) for note in self.notes), limit_s)
        assert told, f"the page did not say {text!r}: {self.notes}"

    def _element(self, label: str) -> str:
        with self._changed:
            assert self._changed.wait_for(lambda: label in self._elements, 10), f"no {label!r} on the page"
            return self._elements[label]

    def _send(self, message: wire.Message) -> None:
        self._socket.send(msgspec.msgpack.encode(message.as_serializable_dict()))

    def _read(self) -> None:
        unpack = zstandard.ZstdDecompressor()
        try:
            for raw in self._socket:
                assert isinstance(raw, bytes)
                size, packed = int.from_bytes(raw[:8], "little"), int.from_bytes(raw[8:16], "little")
                inner = unpack.decompress(raw[16 : 16 + packed], max_output_size=size)
                with self._changed:
                    for message in msgspec.msgpack.decode(inner)["messages"]:
                        self._take(message)
                    self._changed.notify_all()
        except ConnectionClosed:
            return

    def _take(self, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind in ("GuiButtonMessage", "GuiDropdownMessage"):
            self._elements[message["props"]["label"]] = message["uuid"]
        elif kind == "BackgroundImageMessage":
            self.pictures += message["rgb_data"] is not None
        elif kind == "NotificationShowMessage":
            self.notes.append(message["props"]["title"] + " " + message["props"]["body"])
