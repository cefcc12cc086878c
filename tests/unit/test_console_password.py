"""The console's password file."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest

from common.cli import main
from common.config import ConfigError
from ground.console.password import make_hash, read_hash, write_hash

PASSWORD = "brake to rest, then hold"


def test_hash_matches_its_password_alone_and_survives_the_file(tmp_path: Path) -> None:
    path = tmp_path / "password"
    made = make_hash(PASSWORD)
    write_hash(path, made)
    read = read_hash(str(path))

    assert read == made
    assert read.matches(PASSWORD)
    assert not any(read.matches(wrong) for wrong in ("", PASSWORD[:-1], PASSWORD + " ", PASSWORD.upper()))
    assert path.stat().st_mode & 0o777 == 0o600
    assert PASSWORD not in path.read_text()


def test_salt_differs_each_time_and_nothing_of_it_is_printed() -> None:
    first, second = make_hash(PASSWORD), make_hash(PASSWORD)

    assert first.salt != second.salt
    assert first.digest != second.digest
    assert first.session_key() != second.session_key()
    assert repr(first) == "PasswordHash(…)"


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o660])
def test_file_that_others_can_read_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "password"
    write_hash(path, make_hash(PASSWORD))
    path.chmod(mode)

    with pytest.raises(ConfigError, match=re.escape(f"got mode {mode:04o}, expected 0600")):
        read_hash(str(path))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "in clear",
        "scrypt:2:8:1:AAAA:AAAA",
        "scrypt:16384:8:1:AAAA:AAAA",
        "scrypt:16384:8:1:%%%%:AAAA",
        "scrypt:16384:8:1:" + "A" * 2000,
    ],
)
def test_file_that_is_no_hash_is_one_clear_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "password"
    path.write_text(text)
    path.chmod(0o600)

    with pytest.raises(ConfigError, match="make it again with: outrider console-password") as refused:
        read_hash(str(path))
    assert "\n" not in str(refused.value)


def test_missing_file_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"No such file or directory.*make it with"):
        read_hash(str(tmp_path / "password"))


def test_command_takes_the_password_from_a_pipe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "password"
    monkeypatch.setattr("sys.stdin", io.StringIO(PASSWORD + "\n"))

    assert main(["console-password", str(path)]) == 0
    assert read_hash(str(path)).matches(PASSWORD)
    assert PASSWORD not in "".join(capsys.readouterr())
    assert list(tmp_path.iterdir()) == [path]


def test_short_password_is_refused_and_the_old_file_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "password"
    write_hash(path, make_hash(PASSWORD))
    monkeypatch.setattr("sys.stdin", io.StringIO("short\n"))

    assert main(["console-password", str(path)]) == 2
    assert "got 5 characters, expected 10 or more" in capsys.readouterr().err
    assert read_hash(str(path)).matches(PASSWORD)
