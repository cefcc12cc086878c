"""`outrider conformance URL`: the checks against one autopilot, as a table and as JSON."""

from __future__ import annotations

import argparse
import json
import signal
import sys
from pathlib import Path

from common.config import ConfigError
from common.helm_lock import HelmLock, HelmTaken
from simulation.conformance.client import COMPANION, Client
from simulation.conformance.registry import Check, select
from simulation.conformance.report import Result, as_json, details, row, summary
from simulation.conformance.suite import run_checks
from simulation.conformance.vehicle import CannotFly, Vehicle
from simulation.conformance.wire import is_loopback, open_wire

_HEARD_WITHIN_S = 8.0
_LISTEN_S = 1.3
_EXIT_DIFFERS, _EXIT_CONFIG, _EXIT_TAKEN = 1, 2, 3


def main(args: argparse.Namespace) -> int:
    """Run the checks that were asked for.

    Returns:
        0 all pass, 1 something differs, 2 not usable as given, 3 another program holds the link.
    """
    checks = select(args.only, args.quick)
    if args.list:
        for check in checks:
            print(f"{check.name:18}{check.place:9}{'quick' if check.quick else '':7}{check.doc}")
        return 0
    if not args.url:
        raise ConfigError("conformance: got no URL, expected one such as udpin://127.0.0.1:14540")
    if args.json and not Path(args.json).resolve().parent.is_dir():
        raise ConfigError(f"conformance --json: got {args.json}, expected a file in a folder that exists")
    try:
        lock = HelmLock(args.url, "", holder="outrider conformance")
    except HelmTaken as error:
        print(f"outrider: {error}", file=sys.stderr)
        return _EXIT_TAKEN
    try:
        return _with_link(args, checks)
    finally:
        lock.close()


def _with_link(args: argparse.Namespace, checks: list[Check]) -> int:
    wire = open_wire(args.url)
    try:
        client = Client(wire)
        if not client.run(_HEARD_WITHIN_S, lambda: client.target is not None):
            raise ConfigError(
                f"conformance: {args.url}: no autopilot was heard within {_HEARD_WITHIN_S:.0f} s; start it, or correct "
                f"the URL"
            )
        may_fly = args.fly or is_loopback(args.url)
        client.run(_LISTEN_S)
        _refuse_company(client, may_fly)
        return _report(args, client, checks, may_fly)
    finally:
        wire.close()


def _refuse_company(client: Client, may_fly: bool) -> None:
    """Refuse to fly where a companion computer speaks to the same vehicle.

    Raises:
        ConfigError: its heartbeat was heard.
    """
    for (system, component), seen in client.others.items():
        if may_fly and seen.message.type == COMPANION:
            raise ConfigError(
                f"conformance: a companion computer (system {system}, component {component}) is on this vehicle; end "
                f"helm first: one hand commands a vehicle"
            )


def _report(args: argparse.Namespace, client: Client, checks: list[Check], may_fly: bool) -> int:
    vehicle = Vehicle(client)
    # A shell that starts it in the background leaves SIGINT ignored, and it has to land the vehicle all the same.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if may_fly:
        print(f"WARNING: this arms and flies the vehicle at {args.url}, 5 m high and 25 m around. Ctrl-C lands it.")
    else:
        print(f"{args.url} is no simulation on this machine: motors stay off without --fly.")
    results: list[Result] = []

    def tell(result: Result) -> None:
        results.append(result)
        print(row(result), flush=True)
        if args.verbose:
            print(details(result), flush=True)

    try:
        run_checks(vehicle, checks, may_fly, tell)
    except CannotFly as error:
        print(f"outrider: conformance: NOT CLEANED UP: {error}; take over by hand", file=sys.stderr)
        return _EXIT_DIFFERS
    except KeyboardInterrupt:
        print("ended by Ctrl-C; the vehicle is landed and disarmed, its parameters are back")
        return 130
    finally:
        print(summary(results))
        if args.json:
            Path(args.json).write_text(json.dumps(as_json(args.url, results), indent=2) + "\n", encoding="utf-8")
    return _EXIT_DIFFERS if any(r.failed for r in results) else 0
