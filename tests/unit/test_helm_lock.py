"""One helm per link: in this process, across processes, and after a kill."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from common.config import ConfigError
from common.helm_lock import HelmLock, HelmTaken, require_free_port
from common.runner import AlreadyRunning

_ROOT = Path(__file__).parents[2]
_URL = "udpin://127.0.0.1:24999"
_HOLDER = (
    "import sys, time; from pathlib import Path; from common.helm_lock import HelmLock; "
    "lock = HelmLock(sys.argv[1], 'kite', Path(sys.argv[2])); print('held', flush=True); time.sleep(60)"
)


def test_a_second_helm_is_refused_by_name_until_the_first_dies(tmp_path: Path):
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDER, _URL, str(tmp_path)], cwd=_ROOT, stdout=subprocess.PIPE, text=True
    ) as holder:
        try:
            assert holder.stdout and holder.stdout.readline() == "held\n"
            with pytest.raises(HelmTaken, match=rf"process {holder.pid}; one helm commands a vehicle") as refused:
                HelmLock(_URL, "kite", tmp_path)
            assert isinstance(refused.value, AlreadyRunning)
            HelmLock("udpin://127.0.0.1:24998", "kite", tmp_path).close()
        finally:
            holder.send_signal(signal.SIGKILL)
            holder.wait()
    HelmLock(_URL, "kite", tmp_path).close()


def test_a_closed_lock_is_free_again(tmp_path: Path):
    for _ in range(2):
        HelmLock(_URL, "kite", tmp_path).close()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_that_cannot_be_written_is_said_so(tmp_path: Path):
    with pytest.raises(ConfigError, match="XDG_RUNTIME_DIR"):
        HelmLock(_URL, "kite", tmp_path / "absent")


def test_a_port_in_use_is_refused_with_its_number():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match=f"UDP port {port} cannot be opened"):
            require_free_port(port, f"udpin://127.0.0.1:{port}")
    require_free_port(port, "now free")
