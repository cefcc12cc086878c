"""The `outrider` command."""

from __future__ import annotations

import argparse
import contextlib
import logging
import math
import sys
from collections.abc import Sequence

from common import __version__, topics, track_command
from common.bus import Bus
from common.config import ConfigError, load_object
from common.keys_options import add_keys
from common.launch import run_process, run_side, set_up_logging
from common.messages import Command
from common.processes import PROCESSES, load_config, process, side_processes
from common.session import BusConfig, RouterAbsent, Side, check_keys
from common.supervisor import EXIT_CONFIG

_EPILOG = """\
Three terminals, in any order:
  outrider sim                          the world and the simulated autopilot (PX4 instead: docs/px4.md)
  outrider onboard --config kite        camera and helm, on the vehicle
  outrider ground  --config kite        tracker, console and recorder; console on http://localhost:8080
Then fly from the console, or from a fourth:
  outrider do takeoff --height 5
  outrider do select 300,220,60,40
  outrider do chase
  outrider do land
"""


_POSE_PORTS = {"truth": 19410, "local": 19420}
"""Where the world listens by default: PX4's SIH sends its truth to 19410; 19420 is that of `deploy/px4`."""
_POSE_ASKED = {"truth": 19450, "local": 19460}
"""Where it asks for message rates until it hears a pose."""


def _add_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config",
        metavar="FILE",
        default="kite",
        help="vehicle file: a path, or a name in deploy/vehicles (default: kite)",
    )
    parser.add_argument(
        "--set",
        metavar="SECTION.KEY=VALUE",
        action="append",
        default=[],
        dest="overrides",
        help="override one key of the vehicle file; may be repeated",
    )
    parser.add_argument("--verbose", action="store_true", help="log the resolved configuration and details")


def _add_side(subparsers: argparse._SubParsersAction, side: Side, doc: str) -> argparse.ArgumentParser:
    names = "\n".join(f"  {p.name:15} {p.doc}" for p in side_processes(side))
    parser = subparsers.add_parser(
        side,
        help=doc,
        description=f"{doc}.\n\nProcesses:\n{names}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_config(parser)
    parser.add_argument(
        "--without", metavar="NODE", action="append", default=[], help="leave out a process; may be repeated"
    )
    return parser


def _add_pose(parser: argparse.ArgumentParser) -> None:
    """Where the world learns the pose of a vehicle that another autopilot flies."""
    parser.add_argument(
        "--pose",
        choices=tuple(_POSE_PORTS),
        help="external autopilot: the pose comes as truth (HIL_STATE_QUATERNION, as PX4's SIH sends it; default), or "
        "as the autopilot's own estimate on a link of the world's own (local: LOCAL_POSITION_NED, ATTITUDE_QUATERNION)",
    )
    ports = ", ".join(f"{source} {port}" for source, port in _POSE_PORTS.items())
    parser.add_argument("--pose-port", type=int, metavar="PORT", help=f"UDP port that it comes to (default: {ports})")


def _pose_overrides(external: bool, pose: str | None, port: int | None) -> list[str]:
    """Settings of the world for an external autopilot; none for Outrider's own.

    Raises:
        ConfigError: a pose option without an external autopilot.
    """
    if external:
        source = pose or "truth"
        # The autopilot's home is not the vehicle file's: the ground is where the vehicle first stands.
        return [
            "world.home=first",
            f"world.source={source}",
            f"world.port={port or _POSE_PORTS[source]}",
            f"world.autopilot_port={_POSE_ASKED[source]}",
        ]
    if pose is not None or port is not None:
        raise ConfigError(
            f"{'--pose' if pose else '--pose-port'}: got {pose or port} with Outrider's own autopilot, which needs "
            "none; expected it beside --autopilot external (demo: --autopilot URL)"
        )
    return []


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="outrider",
        description="Vision-guided flight: onboard side, ground side, and a world to try them in.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"outrider {__version__}")
    sub = parser.add_subparsers(dest="action", required=True, metavar="COMMAND")

    sim = _add_side(sub, "sim", "Start the simulated world and the simulated autopilot")
    sim.add_argument("--scenario", metavar="FILE", help="scenario file: a path, or a name in deploy/scenarios")
    sim.add_argument(
        "--autopilot",
        dest="pilot",
        choices=("own", "external"),
        default="own",
        help="own: the simulated one; external: the world alone, beside PX4 or another autopilot",
    )
    _add_pose(sim)
    onboard = _add_side(sub, "onboard", "Start the vehicle's side")
    onboard.add_argument(
        "--autopilot",
        metavar="URL",
        help="udpin://HOST:PORT (udpout, tcpin, tcpout) or serial:///dev/NAME:BAUD; default udpin://127.0.0.1:14540",
    )
    onboard.add_argument("--source", metavar="SOURCE", help="/dev/video0, rtsp://…, a video file or an image folder")
    _add_side(sub, "ground", "Start the ground station's side")

    node = sub.add_parser(
        "node",
        help="Start one process alone",
        description="Start one process of any side alone.",
        epilog="\n".join(f"  {p.name:15} {p.doc}" for p in PROCESSES.values()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    node.add_argument("name", metavar="NAME", help="process name, see below")
    _add_config(node)
    node.add_argument("--source", metavar="PATH", help="camera: as for `onboard`")

    _add_do(sub)
    _add_topics(sub)
    _add_preflight(sub)
    _add_doctor(sub)
    _add_config(track_command.add(sub))
    _add_demo(sub)
    password = sub.add_parser(
        "console-password",
        help="Set the console's password",
        description="Ask for the console's password (or read it from a pipe) and write its salted hash, mode 0600.",
    )
    password.add_argument("file", metavar="FILE", help="the file that console.password_file names")
    _add_conformance(sub)
    _add_config(add_keys(sub))
    sub.add_parser("bench", help="Run a benchmark", add_help=False)  # reads its arguments itself, -h among them
    return parser


def _add_do(sub: argparse._SubParsersAction) -> None:
    do = sub.add_parser(
        "do",
        help="Give the vehicle a command, as the console's buttons do",
        description="Give a command and print the reply; exit code 0 when done, 1 otherwise.",
        epilog="\n".join(f"  {c.name.split('/')[-1]:10} {c.doc}" for c in topics.COMMANDS.values()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    do.add_argument("command", metavar="COMMAND", help="see below")
    do.add_argument("box", nargs="?", metavar="X,Y,W,H", help="select: the target's box in the picture, px")
    do.add_argument("--height", type=float, metavar="M", help="takeoff: height above home, m")
    do.add_argument("--side", choices=("onboard", "ground"), default="ground", help="whose router to use")
    _add_config(do)


def _add_topics(sub: argparse._SubParsersAction) -> None:
    parser = sub.add_parser(
        "topics",
        help="Show the live bus",
        description="List the streams, measure them (hz), or print their messages (echo).",
    )
    parser.add_argument("verb", nargs="?", choices=("list", "hz", "echo"), default="list")
    parser.add_argument("names", nargs="*", metavar="TOPIC", help="topic names; hz without any measures all")
    parser.add_argument("--seconds", type=float, default=3.0, help="how long to listen (list, hz)")
    parser.add_argument("--count", type=int, default=0, help="echo: stop after so many messages (default: never)")
    parser.add_argument("--side", choices=("onboard", "ground"), default="ground", help="whose router to use")
    _add_config(parser)


def _add_preflight(sub: argparse._SubParsersAction) -> None:
    parser = sub.add_parser(
        "preflight",
        help="Show whether helm would arm, and why not",
        description="Print helm's gate, each check with what was found and what to do; exit code 0 when it is open, "
        "1 when it is closed, 2 when no helm answers.",
    )
    parser.add_argument("--wait", type=_seconds, default=0.0, metavar="S", help="wait so long for the gate to open")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--side", choices=("onboard", "ground"), default="ground", help="whose router to use")
    _add_config(parser)


def _add_doctor(sub: argparse._SubParsersAction) -> None:
    parser = sub.add_parser(
        "doctor",
        help="Look for what is wrong on this machine and in the running system",
        description="Look at graphics, cores, memory, ports, routers, autopilot, camera, clocks, disk and packages, "
        "and say what to do; exit code 0 without faults, 1 with.",
    )
    parser.add_argument(
        "--side", choices=("onboard", "ground", "sim", "all"), default="all", help="sides that run on this machine"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    _add_config(parser)


def _seconds(text: str) -> float:
    with contextlib.suppress(ValueError):
        if 0.0 <= (value := float(text)) < math.inf:
            return value
    raise argparse.ArgumentTypeError(f"got {text!r}, expected seconds, 0 or more")


def _add_demo(sub: argparse._SubParsersAction) -> None:
    demo = sub.add_parser(
        "demo",
        help="All three sides on this machine: take off and chase the car",
        description="Start simulation, onboard side and ground side, take off, select the car and "
        "chase it until Ctrl-C. Console on http://localhost:8080.",
    )
    demo.add_argument("--headless", action="store_true", help="no console; judge the chase by its exit code")
    demo.add_argument("--duration", type=float, metavar="S", help="chase for so long, then land and end")
    demo.add_argument("--report", metavar="FILE", help="write errors, losses and latencies as JSON")
    demo.add_argument("--scenario", metavar="FILE", default="chase", help="scenario (default: chase)")
    demo.add_argument("--seed", type=int, help="seed of the scenario's randomness")
    demo.add_argument(
        "--autopilot", metavar="URL", help="fly PX4 or another autopilot at this URL instead of the simulated one"
    )
    _add_pose(demo)
    _add_config(demo)


def _add_conformance(sub: argparse._SubParsersAction) -> None:
    parser = sub.add_parser(
        "conformance",
        help="Check that an autopilot behaves as PX4 does, at any URL",
        description="Contract tests of the MAVLink surface: prints passes and differences. It commands the vehicle "
        "itself, without helm, and flies only a simulation on this machine, or with --fly.",
    )
    parser.add_argument("url", nargs="?", metavar="URL", help="MAVLink URL, such as udpin://127.0.0.1:14540")
    parser.add_argument("--quick", action="store_true", help="the checks of a short run")
    parser.add_argument("--only", metavar="NAME", action="append", default=[], help="one check; may be repeated")
    parser.add_argument("--fly", action="store_true", help="spin the motors also where the URL is not loopback")
    parser.add_argument("--json", metavar="FILE", help="write the report as JSON")
    parser.add_argument("--list", action="store_true", help="list the checks")
    parser.add_argument("--verbose", action="store_true", help="show every comparison")


def _run_side(args: argparse.Namespace) -> int:
    external = getattr(args, "pilot", "own") == "external"
    overrides = _pose_overrides(external, getattr(args, "pose", None), getattr(args, "pose_port", None))
    overrides += args.overrides  # the user's own settings win
    if getattr(args, "scenario", None):
        overrides.append(f"world.scenario={args.scenario}")
    if getattr(args, "autopilot", None):
        overrides.append(f"helm.autopilot_url={args.autopilot}")
    if getattr(args, "source", None):
        overrides.append(f"video.source={args.source}")
    # Refuse what is bad here, once, before anything starts.
    check_keys(load_config(args.config, overrides).section(BusConfig), args.action)
    arguments = ["--config", args.config, *(part for text in overrides for part in ("--set", text))]
    without = [*args.without, "autopilot"] if external else args.without
    return run_side(args.action, arguments + (["--verbose"] if args.verbose else []), without)


def _run_node(args: argparse.Namespace) -> int:
    overrides = list(args.overrides) + ([f"video.source={args.source}"] if args.source else [])
    return run_process(process(args.name), load_config(args.config, overrides))


def _run_do(args: argparse.Namespace) -> int:
    commands = {name.split("/")[-1]: name for name in topics.COMMANDS}
    if args.command not in commands:
        raise ConfigError(f"do: got {args.command!r}, expected one of: {', '.join(commands)}")
    box = None
    if args.box:
        try:
            x, y, w, h = (float(part) for part in args.box.split(","))
        except ValueError:
            raise ConfigError(f"do {args.command}: got box {args.box!r}, expected X,Y,W,H in px") from None
        box = (x, y, w, h)
    with Bus(load_config(args.config, args.overrides).section(BusConfig), args.side, "cli", wait_s=3.0) as bus:
        reply = bus.query(commands[args.command], Command(box_px=box, height_m=args.height, operator="command line"))
    print(f"{args.command}: {reply.outcome}" + (f": {reply.reason}" if reply.reason else ""))
    return 0 if reply.outcome == "done" else 1


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
    _pose_overrides(args.autopilot is not None, args.pose, args.pose_port)  # refuses what does not belong together
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
    "topics": _run_topics,
    "preflight": _run_preflight,
    "doctor": _run_doctor,
    "track": lambda args: track_command.run(args, load_config(args.config, args.overrides)),
    "demo": _run_demo,
    "console-password": _run_console_password,
    "conformance": _run_conformance,
    "keys": lambda args: load_object("common.keys:run")(args),
    "bench": _run_bench,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 1 failed, 2 not usable as given, 3 already running)."""
    parser = _parser()
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
