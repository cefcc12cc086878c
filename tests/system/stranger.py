"""A client that is not ours, run as a process on a machine of its own: `python stranger.py ATTEMPTS`.

ATTEMPTS is JSON, `[{"endpoint": …, "settings": {path: value}}, …]`. For each it tries for 1.5 s to be let in, then for
another 1.5 s to read every stream, to write requests and to give a command. Prints one JSON object an attempt.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import zenoh

OPEN_MS = 1500
LISTEN_S = 1.5


def attempt(endpoint: str, settings: dict[str, Any], payload: bytes) -> dict[str, Any]:
    """What one way in brings: whether it opens, how many pictures and streams are read, who answers a command."""
    config = zenoh.Config()
    base: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": OPEN_MS,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
    }
    for path, value in (base | settings).items():
        config.insert_json5(path, json.dumps(value))
    seen: list[str] = []
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        return {"opened": False, "frames": 0, "streams": [], "answers": 0, "error": str(error)[:200]}
    with session:
        session.declare_subscriber("outrider/kite/**", lambda sample: seen.append(str(sample.key_expr)))
        ends_s = time.monotonic() + LISTEN_S
        while time.monotonic() < ends_s:
            session.put("outrider/kite/helm/request/operator", payload)
            time.sleep(0.05)
        answers = sum(r.ok is not None for r in session.get("outrider/kite/helm/do/disarm", timeout=1.0))
    streams = set(seen) - {"outrider/kite/helm/request/operator"}  # its own come back to it
    frames = seen.count("outrider/kite/camera/down/jpeg")
    return {"opened": True, "frames": frames, "streams": sorted(streams), "answers": answers, "error": ""}


if __name__ == "__main__":
    for way in json.loads(sys.argv[1]):
        print(json.dumps(attempt(way["endpoint"], way["settings"], b"not a request")), flush=True)
