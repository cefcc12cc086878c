"""What the `outrider` command understands: its subcommands and their options."""

from __future__ import annotations

import argparse

from common import __version__, evaluate_command, people_command, stick_command, topics, track_command
from common.arguments import seconds, seed
from common.keys_options import add_keys
from common.pose_options import add_pose
from common.processes import PROCESSES, side_processes
from common.session import Side

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


def make_parser() -> argparse.ArgumentParser:
    """Parser of the whole command line; `bench` is left to read its own arguments."""
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
    add_pose(sim)
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
    _add_config(stick_command.add(sub))
    _add_topics(sub)
    _add_preflight(sub)
    _add_doctor(sub)
    _add_config(track_command.add(sub), default=None)
    evaluate_command.add(sub)
    _add_config(people_command.add(sub), default=None)
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
        epilog="\n".join(f"  {word:15} {topics.COMMANDS[name].doc}" for word, name in topics.commands_by_word().items())
        + f"\n  {stick_command.NAME:15} {stick_command.DOC}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    do.add_argument("command", metavar="COMMAND", help="see below")
    do.add_argument(
        "argument",
        nargs="?",
        metavar="X,Y,W,H|on|off",
        help="select, follow-select: the target's box, px; push-back: on or off",
    )
    do.add_argument("--height", type=float, metavar="M", help="takeoff: height above home, m")
    do.add_argument(
        "--label",
        default="",
        metavar="NAME",
        help="approach-select, rename, merge, dismiss: name of the thing or person",
    )
    do.add_argument("--name", dest="called", default="", metavar="NAME", help="rename: what the person is called now")
    do.add_argument("--into", default="", metavar="NAME", help="merge: the person that the other is the same as")
    do.add_argument(
        "--bearing", type=float, metavar="DEG", help="approach-select: its direction from the nose, clockwise, degrees"
    )
    stick_command.add_options(do)
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
    parser.add_argument("--wait", type=seconds, default=0.0, metavar="S", help="wait so long for the gate to open")
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


def _add_demo(sub: argparse._SubParsersAction) -> None:
    demo = sub.add_parser(
        "demo",
        help="All three sides on this machine: take off and chase the car, fly at a barrel, or search",
        description="Start simulation, onboard side and ground side, take off, select the car and chase it until "
        "Ctrl-C; with --scenario approach: fly at a barrel by the stick, stop before it, approach it, and leave the "
        "stick to you; with --scenario rescue: search an area, find the people there, fly up to the one that you pick. "
        "Console on http://localhost:8080.",
    )
    demo.add_argument("--headless", action="store_true", help="no console; judge the flight by its exit code")
    demo.add_argument(
        "--duration", type=float, metavar="S", help="chase (or leave the stick to you) so long, then land and end"
    )
    demo.add_argument("--report", metavar="FILE", help="write errors, losses and latencies as JSON")
    demo.add_argument(
        "--scenario", metavar="FILE", default="chase", help="scenario: chase (default), approach, rescue, …"
    )
    demo.add_argument("--seed", type=seed, help="seed of the scenario's randomness")
    demo.add_argument(
        "--autopilot", metavar="URL", help="fly PX4 or another autopilot at this URL instead of the simulated one"
    )
    add_pose(demo)
    _add_config(demo, default=None, otherwise="the scenario's: kite, heron or osprey")


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


def _add_config(
    parser: argparse.ArgumentParser, default: str | None = "kite", otherwise: str = "none, all keys as they are"
) -> None:
    parser.add_argument(
        "--config",
        metavar="FILE",
        default=default,
        help=f"vehicle file: a path, or a name in deploy/vehicles (default: {default or otherwise})",
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
