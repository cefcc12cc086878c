"""Who holds a port of this machine, from the kernel's tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from common.doctor.finding import Finding, fault, ok

Protocol = Literal["tcp", "udp"]
_TCP_LISTEN = "0A"


@dataclass(frozen=True)
class PortUse:
    """A port that the configuration names."""

    protocol: Protocol
    """TCP or UDP."""
    port: int
    """Number."""
    node: str
    """Process of ours that opens it."""
    setting: str
    """Key that moves it."""


def holders(protocol: Protocol, port: int) -> list[tuple[int, str]]:
    """Process identifier and command line of each process that listens there; (0, "") for one of another user."""
    inodes = set()
    for table in (protocol, f"{protocol}6"):
        for line in Path(f"/proc/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            fields = line.split()
            listens = protocol == "udp" or fields[3] == _TCP_LISTEN
            if listens and int(fields[1].rsplit(":", 1)[1], 16) == port:
                inodes.add(f"socket:[{fields[9]}]")
    if not inodes:
        return []
    return sorted(set(_owners(inodes))) or [(0, "")]


def _owners(inodes: set[str]) -> Iterator[tuple[int, str]]:
    for process in Path("/proc").iterdir():
        if not process.name.isdigit():
            continue
        try:
            if any(str(entry.readlink()) in inodes for entry in (process / "fd").iterdir()):
                words = (process / "cmdline").read_bytes().decode(errors="replace").split("\0")
                yield int(process.name), " ".join(words).strip()
        except OSError:  # it ended, or belongs to another user
            continue


def examine_ports(uses: Iterable[PortUse]) -> Iterator[Finding]:
    """A finding for each port: free, held by the process that is meant to hold it, or taken."""
    for use in uses:
        subject = f"{use.protocol.upper()} port {use.port}"
        found = holders(use.protocol, use.port)
        ours = [pid for pid, command in found if f" node {use.node}" in f" {command} "]
        others = [(pid, command) for pid, command in found if pid not in ours]
        if others:
            pid, command = others[0]
            who = f"process {pid} ({command[:80]})" if pid else "a process of another user"
            yield fault(
                subject, f"held by {who}, expected {use.node} or nobody", f"end that process, or change {use.setting}"
            )
        elif len(ours) > 1:
            yield fault(subject, f"held by {len(ours)} processes of {use.node}", f"end all but one: {ours}")
        else:
            yield ok(subject, f"held by {use.node}, process {ours[0]}" if ours else f"free for {use.node}")


def tcp_port(endpoint: str) -> int:
    """Port of a router's endpoint (`tcp/127.0.0.1:7447`)."""
    return int(endpoint.split("?")[0].split("#")[0].rsplit(":", 1)[1])
