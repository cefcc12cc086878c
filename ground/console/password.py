"""The console's password, kept as a salted scrypt hash in a file for its owner alone."""

from __future__ import annotations

import base64
import binascii
import getpass
import hashlib
import hmac
import os
import secrets
import stat
import sys
from dataclasses import dataclass
from pathlib import Path

from common.config import ConfigError

SHORTEST = 10
"""Characters that a password has at least."""
# Cost 2**14, block 8, lanes 1: 16 MB and some 40 ms a try on a desktop's core (RFC 7914, section 2).
_COST, _BLOCK, _LANES = 2**14, 8, 1
_SALT_BYTES = 16
_HASH_BYTES = 32
_LONGEST_FILE = 1024


@dataclass(frozen=True)
class PasswordHash:
    """Salt and scrypt hash of a password; neither is shown in a log."""

    salt: bytes
    digest: bytes

    def matches(self, password: str) -> bool:
        """Whether this is the password; takes the same time for every wrong one."""
        return hmac.compare_digest(_scrypt(password, self.salt), self.digest)

    def session_key(self) -> bytes:
        """Key that signs sessions: sessions outlive a restart of the console and end when the password changes."""
        return hmac.digest(self.digest, b"outrider console session", "sha256")

    def __repr__(self) -> str:
        return "PasswordHash(…)"


def _scrypt(password: str, salt: bytes) -> bytes:
    text = password.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(text, salt=salt, n=_COST, r=_BLOCK, p=_LANES, dklen=_HASH_BYTES)


def make_hash(password: str) -> PasswordHash:
    """Hash of a new password with a salt of its own.

    Raises:
        ConfigError: too short.
    """
    if len(password) < SHORTEST:
        raise ConfigError(f"console password: got {len(password)} characters, expected {SHORTEST} or more")
    salt = secrets.token_bytes(_SALT_BYTES)
    return PasswordHash(salt, _scrypt(password, salt))


def write_hash(path: Path, kept: PasswordHash) -> None:
    """Write the file with mode 0600, replacing an older one as a whole.

    Raises:
        ConfigError: the folder cannot be written.
    """
    fields = (base64.b64encode(part).decode() for part in (kept.salt, kept.digest))
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(f"scrypt:{_COST}:{_BLOCK}:{_LANES}:{':'.join(fields)}\n")
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise ConfigError(f"console password: cannot write {str(path)!r} ({error.strerror})") from None


def read_hash(name: str) -> PasswordHash:
    """Hash from a file that nobody but its owner can read.

    Args:
        name: path, as configured; `~` is the user's home.

    Raises:
        ConfigError: no such file, open to others, of another user, or no file of `outrider console-password`.
    """
    path = Path(name).expanduser()
    what = f"console.password_file: {str(path)!r}"
    try:
        with path.open("rb") as file:
            status = os.fstat(file.fileno())
            text = file.read(_LONGEST_FILE + 1).decode("ascii", "replace")
    except OSError as error:
        raise ConfigError(
            f"{what} cannot be read ({error.strerror}); make it with: outrider console-password {name}"
        ) from None
    mode = stat.S_IMODE(status.st_mode)
    if mode & 0o077:
        raise ConfigError(f"{what}: got mode {mode:04o}, expected 0600, for its owner alone; run: chmod 600 {name}")
    if status.st_uid not in (os.geteuid(), 0):
        raise ConfigError(
            f"{what}: got owner {status.st_uid}, expected {os.geteuid()}, the user of the console, or root"
        )
    return _parse(text, what, name)


def _parse(text: str, what: str, name: str) -> PasswordHash:
    again = f"{what}: not a file of this version; make it again with: outrider console-password {name}"
    fields = text.strip().split(":")
    if fields[:4] != ["scrypt", str(_COST), str(_BLOCK), str(_LANES)] or len(fields) != 6:
        raise ConfigError(again)
    try:
        salt, digest = (base64.b64decode(field, validate=True) for field in fields[4:])
    except (binascii.Error, ValueError):
        raise ConfigError(again) from None
    if len(salt) != _SALT_BYTES or len(digest) != _HASH_BYTES:
        raise ConfigError(again)
    return PasswordHash(salt, digest)


def ask_and_write(name: str) -> int:
    """Ask for a password, twice at a terminal, once from a pipe, and write its hash; returns the exit code.

    Raises:
        ConfigError: too short, the two differ, or the file cannot be written.
    """
    if sys.stdin.isatty():
        password = getpass.getpass("Password of the console: ")
        if password != getpass.getpass("Once more: "):
            raise ConfigError("console password: the two are not the same; nothing was written")
    else:
        password = sys.stdin.readline().rstrip("\r\n")
    path = Path(name).expanduser()
    write_hash(path, make_hash(password))
    print(f"{path}: written; use it with console.password_file, and restart the console")
    return 0
