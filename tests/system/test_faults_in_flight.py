"""One flight, many faults: what the vehicle does when processes die while it chases."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import msgspec
import numpy as np
import zenoh

from common import topics
from common.codec import encode, schema_hash
from common.header import Header
from common.messages import Request
from tests.system.flight import LANDS_FAST, Flight

MakeFlight = Callable[..., Flight]


def _hovers_soon(flight: Flight, since_ns: int, what: str) -> None:
    """The setpoints fall to a hover, and the vehicle follows them."""
    flight.wait(
        f"hover setpoints after {what}",
        lambda: any(s.message.source == "helm" for s in flight.setpoints.since(since_ns)),
        1.5,
    )
    flight.wait(f"standstill after {what}", lambda: flight.speed_m_s < 0.4, 6)
    assert flight.height_m > 3.5, f"lost height after {what}"


def _chase_again(flight: Flight) -> None:
    """Choose the target anew where the tracker has lost it, and wait until the chase is on."""
    time.sleep(1.0)
    if not flight.tracking:
        flight.wait("answer of the tracker", lambda: flight.pursuit_answers(), 15)
        flight.select()
    if flight.state != "pursuit":
        flight.must("helm/do/chase")
    flight.wait(
        "chase after the fault",
        lambda: (
            flight.tracking
            and flight.state == "pursuit"
            and flight.setpoints.last.source == "pursuit"
            and flight.error_m < 1.5
        ),
        15,
    )


def test_processes_die_in_flight(make_flight: MakeFlight) -> None:
    flight = make_flight("helm.link_loss_after_s=30", LANDS_FAST, console=True)
    stack = flight.stack
    flight.take_off()
    flight.chase()
    settled_ns = time.monotonic_ns() + 4_000_000_000
    time.sleep(10)
    errors = [math.dist(r.message.ned_p_m[:2], r.message.target_ned_p_m[:2]) for r in flight.truth.since(settled_ns)]
    assert len(errors) > 100
    assert max(errors) < 1.2
    flight.check_machine()

    # The tracker dies: hover, no runaway; it comes back without a target and is given one.
    t_ns = time.monotonic_ns()
    pid = stack.kill("pursuit")
    _hovers_soon(flight, t_ns, "the tracker's death")
    flight.wait("a new tracker", lambda: stack.pid("pursuit") not in (None, pid), 6)
    _chase_again(flight)

    # The camera dies: the same, and pictures come again by themselves.
    t_ns = time.monotonic_ns()
    pid = stack.kill("camera")
    flight.wait(
        "hover setpoints without pictures",
        lambda: any(s.message.source == "helm" for s in flight.setpoints.since(t_ns)),
        1.5,
    )
    flight.wait("a new camera", lambda: stack.pid("camera") not in (None, pid), 6)
    _chase_again(flight)

    # The console dies: nobody notices.
    t_ns = time.monotonic_ns()
    pid = stack.kill("console")
    flight.wait("a new console", lambda: stack.pid("console") not in (None, pid), 10)
    assert flight.state == "pursuit"
    assert flight.tracking
    sources = [s.message.source for s in flight.setpoints.since(t_ns)]
    assert sources.count("pursuit") > 0.8 * len(sources)

    # Malformed messages on the bus: refused, counted, without effect.
    _send_rubbish(flight)

    _helm_dies(flight)


def _helm_dies(flight: Flight) -> None:
    """The autopilot holds by itself; the new helm looks, says what it found, and waits to be told."""
    stack = flight.stack
    t_ns = time.monotonic_ns()
    pid = stack.kill("helm")
    flight.wait("standstill after helm's death", lambda: flight.speed_m_s < 0.4, 8)
    flight.wait(
        "a new helm that yields",
        lambda: (
            stack.pid("helm") not in (None, pid)
            and flight.status.since(t_ns + 500_000_000) != []
            and flight.state == "yielded"
        ),
        20,
    )
    restarted_ns = time.monotonic_ns()
    assert flight.status.last.streaming is False
    assert flight.status.last.mode == "HOLD"
    time.sleep(3)
    assert flight.setpoints.since(restarted_ns) == [], "a restarted helm streamed without being told"
    assert flight.state == "yielded"
    assert flight.height_m > 3.5
    assert flight.do("helm/do/chase").outcome == "refused"
    flight.must("helm/do/engage")
    flight.wait("hold after engaging", lambda: flight.state == "hold", 5)
    # The car has driven out of view meanwhile: nothing to chase, and helm says so instead of flying blind.
    flight.land()
    flight.check_machine()
    lowest = min(
        -r.message.ned_p_m[2] for r in flight.truth.all if r.received_ns > t_ns and r.received_ns < restarted_ns
    )
    assert lowest > 3.5


def _send_rubbish(flight: Flight) -> None:
    """Bytes, a NaN, another version, a truncated message, all on the key of the requests."""
    stack = flight.stack
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", f'["tcp/127.0.0.1:{stack.ground_port}"]')
    session = zenoh.open(config)
    key = topics.key("kite", "helm/request/pursuit")
    good = Request(frame="ned", vector=(50.0, 0.0, 0.0), valid_ms=10_000.0)
    header = Header(schema_hash(Request), "stranger", 7, 0, time.monotonic_ns(), time.monotonic_ns())
    payload, attachment = encode(header, good)
    nan = msgspec.msgpack.encode(msgspec.structs.replace(good, vector=(float("nan"), 0.0, 0.0)))
    other_version = encode(msgspec.structs.replace(header, schema=1), good)[1]
    health: list = []
    flight.bus.subscribe("health/helm", health.append)
    since_ns = time.monotonic_ns()
    rubbish = ((b"\x00\xff rubbish", None), (nan, attachment), (payload[:-3], attachment), (payload, other_version))
    for _ in range(20):
        for bytes_, beside in rubbish:
            session.put(key, bytes_, attachment=beside)
            time.sleep(0.01)  # readers keep the latest only: a burst would hide all but its last
    session.close()
    flight.wait(
        "helm's count of refused messages",
        lambda: bool(health) and health[-1].received_ns > since_ns + 2_000_000_000,
        5,
    )
    reasons = {reason.split(": ")[1] for reason in health[-1].message.rejected}
    assert reasons >= {"no header", "content", "malformed", "schema"}
    assert max(flight.sent_speeds_m_s(since_ns), default=0.0) < 3.5
    assert flight.state == "pursuit"
    assert np.isfinite(flight.setpoints.last.ned_v_m_s).all()
