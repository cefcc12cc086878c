"""Machines of a test's own: network namespaces joined by a bridge, each with its own shared memory.

As root they are made with `ip netns`. Everybody else gets the same inside user namespaces when the kernel allows them;
where it does not, `require` says what to do: the test fails with that reason and is never skipped.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

REASON = (
    "this test makes network namespaces: run it as root, or allow user namespaces "
    "(sysctl kernel.unprivileged_userns_clone=1; on Ubuntu kernel.apparmor_restrict_unprivileged_userns=0)"
)


def inside_user_namespace() -> bool:
    """Whether this process may make namespaces."""
    return os.geteuid() == 0


def rerun_in_user_namespace(test: str) -> subprocess.CompletedProcess[str]:
    """Run one test again as root of a user namespace of its own; fails with the reason where that is forbidden."""
    enter = ["unshare", "--user", "--map-root-user", "--net", "--mount"]
    probe = subprocess.run([*enter, "true"], capture_output=True, text=True)
    assert probe.returncode == 0, f"{REASON}: {probe.stderr.strip()}"
    # `ip netns` keeps its names in /run/netns, which is the real root's: a private one takes its place.
    script = 'mount -t tmpfs none /run && mkdir /run/netns && exec "$@"'
    pytest_words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test]
    return subprocess.run([*enter, "sh", "-c", script, "sh", *pytest_words], capture_output=True, text=True)


def _ip(*arguments: str) -> None:
    result = subprocess.run(["ip", *arguments], capture_output=True, text=True)
    assert result.returncode == 0, f"ip {' '.join(arguments)}: {result.stderr.strip()}; {REASON}"


class Machines:
    """Namespaces on one bridge: machine number n has the address 10.77.0.n.

    Args:
        names: of the machines, in order.
    """

    def __init__(self, names: Sequence[str]):
        tag = f"{os.getpid() % 100000:05d}"
        self._hub = f"orhub{tag}"
        self._space = {name: f"or-{name}-{tag}" for name in names}
        self.address = {name: f"10.77.0.{number}" for number, name in enumerate(names, 1)}
        try:
            self._make(tag)
        except BaseException:
            self.remove()
            raise

    def _make(self, tag: str) -> None:
        # The bridge has a namespace of its own: nothing of the test touches this machine's network.
        _ip("netns", "add", self._hub)
        _ip("-n", self._hub, "link", "add", "hub", "type", "bridge")
        _ip("-n", self._hub, "link", "set", "hub", "up")
        for number, (name, space) in enumerate(self._space.items(), 1):
            _ip("netns", "add", space)
            _ip("-n", self._hub, "link", "add", f"p{number}", "type", "veth", "peer", "name", "eth0", "netns", space)
            _ip("-n", self._hub, "link", "set", f"p{number}", "master", "hub", "up")
            _ip("-n", space, "addr", "add", f"{self.address[name]}/24", "dev", "eth0")
            _ip("-n", space, "link", "set", "eth0", "up")
            _ip("-n", space, "link", "set", "lo", "up")

    def command(self, name: str, *words: str) -> list[str]:
        """Words of a command on a machine. Its /dev/shm is empty: memory cannot be shared between machines."""
        own_memory = 'mount -t tmpfs none /dev/shm && exec "$@"'
        return ["ip", "netns", "exec", self._space[name], "unshare", "--mount", "sh", "-c", own_memory, "sh", *words]

    def remove(self) -> None:
        """Remove everything; what was never made is passed over."""
        for space in (*self._space.values(), self._hub):
            if Path("/run/netns", space).exists():
                subprocess.run(["ip", "netns", "del", space], capture_output=True)
