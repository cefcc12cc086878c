"""The folder that `outrider keys` makes, as one machine sees it: which file is where, and who may read it."""

from __future__ import annotations

import stat
from dataclasses import dataclass
from pathlib import Path

from common.access import IDENTITIES, LINK_USER, RouterSide
from common.config import ConfigError


@dataclass(frozen=True)
class SideFiles:
    """Where the files of a side are."""

    folder: Path
    """`<folder of outrider keys>/<side>`: all that this side's machine needs."""

    @property
    def authority(self) -> Path:
        """Certificate of the authority that both routers' certificates are signed by."""
        return self.folder / "ca.pem"

    @property
    def certificate(self) -> Path:
        """Certificate of this side's router."""
        return self.folder / "router.pem"

    @property
    def key(self) -> Path:
        """Private key of this side's router."""
        return self.folder / "router.key"

    @property
    def users(self) -> Path:
        """Names and passwords that this side's router lets in, `name:password` a line."""
        return self.folder / "users.txt"

    def password(self, identity: str) -> Path:
        """Password of one process."""
        return self.folder / "passwords" / identity


def side_files(folder: str | Path, side: RouterSide) -> SideFiles:
    """Paths of a side's files below the folder that `outrider keys` made."""
    return SideFiles(Path(folder) / side)


def read_password(folder: str, side: RouterSide, source: str) -> tuple[str, str]:
    """Name and password under which a process logs in to its router; tools without one of their own are `cli`.

    Raises:
        ConfigError: no such file, or others may read it.
    """
    identity = source if source in (*IDENTITIES[side], LINK_USER) else "cli"
    return identity, read_private(side_files(folder, side).password(identity)).decode().strip()


def read_private(path: Path) -> bytes:
    """Content of a file that nobody else may read; ConfigError otherwise."""
    data = read(path)
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & 0o077:
        raise ConfigError(f"{path}: mode {mode:o} lets others read it, expected 600; run: chmod 600 {path}")
    return data


def read(path: Path) -> bytes:
    """Content of a file; ConfigError when it is missing or unreadable."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise ConfigError(
            f"{path}: missing; make it with `outrider keys` and copy this side's folder to this machine, "
            f"or correct bus.tls.folder"
        ) from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
