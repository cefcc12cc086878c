"""The `outrider` command: what each subcommand does."""

from __future__ import annotations

import argparse
import logging
import math
import sys
from collections.abc import Sequence

from common import evaluate_command, people_command, stick_command, topics, track_command
from common.bus import Bus
from common.cli_parser import make_parser
from common.config import ConfigError, load_object
from common.launch import run_process, run_side, set_up_logging
from common.messages import Command
from common.pose_options import pose_overrides
from common.processes import idle, load_config, process
from common.session import BusConfig, RouterAbsent, Side, check_keys
from common.supervisor import EXIT_CONFIG

_PUSH_BACK = "push-back"


def _run_side(args: argparse.Namespace) -> int:
    external = getattr(args, "pilot", "own") == "external"
    overrides = pose_overrides(external, getattr(args, "pose", None), getattr(args, "pose_port", None))
    overrides += args.overrides  # the user's own settings win
    if getattr(args, "scenario", None):
        overrides.append(f"world.scenario={args.scenario}")
    if getattr(args, "autopilot", None):
        overrides.append(f"helm.autopilot_url={args.autopilot}")
    if getattr(args, "source", None):
        overrides.append(f"video.source={args.source}")
    # Refuse what is bad here, once, before anything starts.
    config = load_config(args.config, overrides)
    check_keys(config.section(BusConfig), args.action)
    arguments = ["--config", args.config, *(part for text in overrides for part in ("--set", text))]
    without = [*args.without, *idle(args.action, config), *(["autopilot"] if external else [])]
    return run_side(args.action, arguments + (["--verbose"] if args.verbose else []), without)


def _run_node(args: argparse.Namespace) -> int:
    overrides = list(args.overrides) + ([f"video.source={args.source}"] if args.source else [])
    return run_process(process(args.name), load_config(args.config, overrides))


def _run_do(args: argparse.Namespace) -> int:
    if args.command == stick_command.NAME:
        return _run_stick(args)
    commands = topics.commands_by_word()
    if args.command not in commands:
        known = ", ".join([*commands, stick_command.NAME])
        raise ConfigError(f"do: got {args.command!r}, expected one of: {known}")
    switched = args.command == _PUSH_BACK
    argument = Command(
        box_px=_box(args) if args.argument and not switched else None,
        on=_switch(args) if switched else None,
        height_m=args.height,
        label=args.label,
        name=args.called,
        into=args.into,
        bearing_rad=None if args.bearing is None else math.radians(args.bearing),
        operator="command line",
    )
    with Bus(load_config(args.config, args.overrides).section(BusConfig), args.side, "cli", wait_s=3.0) as bus:
        reply = bus.query(commands[args.command], argument)
    print(f"{args.command}: {reply.outcome}" + (f": {reply.reason}" if reply.reason else ""))
    return 0 if reply.outcome == "done" else 1


def _box(args: argparse.Namespace) -> tuple[float, float, float, float]:
    try:
        x, y, w, h = (float(part) for part in args.argument.split(","))
    except ValueError:
        raise ConfigError(f"do {args.command}: got box {args.argument!r}, expected X,Y,W,H in px") from None
    return (x, y, w, h)


def _switch(args: argparse.Namespace) -> bool:
    if args.argument not in ("on", "off"):
        raise ConfigError(f"do {args.command}: got {args.argument or 'nothing'!r}, expected on or off")
    return args.argument == "on"


def _run_stick(args: argparse.Namespace) -> int:
    push = stick_command.push_of(args)  # refuses what is bad before anything is waited for
    with Bus(load_config(args.config, args.overrides).section(BusConfig), args.side, "cli", wait_s=3.0) as bus:
        return stick_command.hold(bus, push)


def _run_topics(args: argparse.Namespace) -> int:
    from common import topics_tool

    with Bus(load_config(args.config, args.overrides).section(BusConfig), args.side, "cli", wait_s=3.0) as bus:
        if args.verb == "hz":
            topics_tool.hz(bus, args.names, args.seconds)
        elif args.verb == "echo":
            if len(args.names) != 1:
                raise ConfigError(f"topics echo: got {len(args.names)} names, expected one topic")
            topics_tool.echo(bus, args.names[0], args.count)
        else:
            topics_tool.list_topics(bus, args.seconds)
    return 0


def _run_preflight(args: argparse.Namespace) -> int:
    from common import preflight_tool

    config = load_config(args.config, args.overrides).section(BusConfig)
    with Bus(config, args.side, "cli", wait_s=max(3.0, args.wait)) as bus:
        return preflight_tool.preflight(bus, args.wait, args.json)


def _run_doctor(args: argparse.Namespace) -> int:
    from common.doctor.run import doctor

    if not args.verbose:
        logging.disable(logging.WARNING)  # what the libraries say on the way is among the findings
    sides: tuple[Side, ...] = ("onboard", "ground", "sim") if args.side == "all" else (args.side,)
    try:
        return doctor(load_config(args.config, args.overrides), sides, args.json)
    finally:
        logging.disable(logging.NOTSET)


def _run_demo(args: argparse.Namespace) -> int:
    pose_overrides(args.autopilot is not None, args.pose, args.pose_port)  # refuses what does not belong together
    return load_object("simulation.demo.run:main")(args)


def _run_console_password(args: argparse.Namespace) -> int:
    return load_object("ground.console.password:ask_and_write")(args.file)


def _run_conformance(args: argparse.Namespace) -> int:
    return load_object("simulation.conformance.process:main")(args)


def _run_bench(args: argparse.Namespace) -> int:
    return load_object("benchmarks.run:main")(args.arguments)


_ACTIONS = {
    "sim": _run_side,
    "onboard": _run_side,
    "ground": _run_side,
    "node": _run_node,
    "do": _run_do,
    "stick": _run_stick,
    "topics": _run_topics,
    "preflight": _run_preflight,
    "doctor": _run_doctor,
    "evaluate": evaluate_command.run,
    "track": lambda args: track_command.run(args, load_config(args.config, args.overrides)),
    "people": lambda args: people_command.run(args, load_config(args.config, args.overrides)),
    "demo": _run_demo,
    "console-password": _run_console_password,
    "conformance": _run_conformance,
    "keys": lambda args: load_object("common.keys:run")(args),
    "bench": _run_bench,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 1 failed, 2 not usable as given, 3 already running)."""
    parser = make_parser()
    args, rest = parser.parse_known_args(argv)
    if args.action == "bench":
        args.arguments = rest
    elif rest:
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    set_up_logging(getattr(args, "name", None) or args.action, getattr(args, "verbose", False))
    try:
        return _ACTIONS[args.action](args)
    except (ConfigError, RouterAbsent) as error:
        print(f"outrider: {error}", file=sys.stderr)
        return EXIT_CONFIG
    except KeyError as error:
        if error.args and str(error.args[0]).startswith("unknown topic"):
            print(f"outrider: {error.args[0]}", file=sys.stderr)
            return EXIT_CONFIG
        raise
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
