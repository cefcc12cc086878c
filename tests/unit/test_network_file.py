import hashlib
import sys
from pathlib import Path

import pytest

from common.config import ConfigError
from onboard.people.network_file import NetworkFile

CONTENT = b"weights"
FILE = NetworkFile("pose model", "small.tflite", hashlib.sha256(CONTENT).hexdigest(), "`scripts/setup.sh run`")


@pytest.fixture(autouse=True)
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    return tmp_path / "share" / "outrider"


def test_what_was_stored_is_found_with_its_licence(environment: Path) -> None:
    FILE.store(CONTENT, b"Apache-2.0")
    assert FILE.checked().read_bytes() == CONTENT
    assert sorted(path.name for path in environment.iterdir()) == ["small.LICENSE", "small.tflite"]
    assert (environment / "small.LICENSE").read_bytes() == b"Apache-2.0"


def test_another_content_is_not_stored(environment: Path) -> None:
    with pytest.raises(ConfigError, match=r"pose model: what the package holds has SHA-256 .* nothing was stored"):
        FILE.store(b"other", b"")
    assert not environment.exists()


def test_a_missing_file_says_what_fetches_it() -> None:
    with pytest.raises(ConfigError, match=r"small\.tflite does not exist; `scripts/setup\.sh run` fetches it"):
        FILE.checked()


def test_a_changed_file_is_refused() -> None:
    FILE.store(CONTENT, b"")
    FILE.path.write_bytes(b"damaged")
    with pytest.raises(ConfigError, match=r"remove it, then run `scripts/setup\.sh run`"):
        FILE.checked()
