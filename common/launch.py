"""Starting things: one node in this process, or all processes of a side under a supervisor."""

from __future__ import annotations

import inspect
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, cast

import msgspec

from common.config import Config, ConfigError, load_object
from common.node import Node
from common.processes import ProcessSpec, side_processes
from common.runner import AlreadyRunning, Runner
from common.session import BusConfig, RouterAbsent, Side
from common.supervisor import EXIT_ALREADY_RUNNING, EXIT_CONFIG, Supervisor

log = logging.getLogger(__name__)


def set_up_logging(name: str, verbose: bool = False) -> None:
    """Log to standard error, one line an event, with the process's name."""
    formatter = logging.Formatter(f"%(asctime)s.%(msecs)03d %(levelname)-7s {name}: %(message)s", "%H:%M:%S")
    formatter.converter = time.gmtime
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter)
    logging.basicConfig(level=logging.DEBUG if verbose else logging.INFO, handlers=[handler], force=True)
    for noisy in ("websockets", "asyncio", "matplotlib", "PIL", "OpenGL"):
        logging.getLogger(noisy).setLevel(logging.WARNING)


def stop_on_signals() -> tuple[threading.Event, list[Callable[[], None]]]:
    """An event that SIGINT and SIGTERM set, and a list of functions to call when they do."""
    stop = threading.Event()
    wake: list[Callable[[], None]] = []

    def handle(signum: int, frame: object) -> None:
        stop.set()
        for function in wake:
            function()

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    return stop, wake


def run_process(spec: ProcessSpec, config: Config) -> int:
    """Run one entry of the process table in this process until a signal ends it; returns the exit code."""
    stop, wake = stop_on_signals()
    try:
        entry: Any = load_object(spec.entry)
        log.debug("configuration %s", msgspec.json.encode(config.resolved()).decode())
        if not inspect.isclass(entry):
            return entry(config, stop)
        node = cast(type[Node], entry)(config, spec.name)
        try:
            runner = Runner(node, config.section(BusConfig), spec.side, stop)
        except ConfigError:
            node.close()  # what it opened must not outlive it
            raise
        wake.append(runner.wake)
        try:
            runner.open()
            return runner.run(stop)
        finally:
            runner.close()
    except RouterAbsent:
        return 0  # told to stop while still waiting for the router
    except AlreadyRunning as error:
        return _fail(error, EXIT_ALREADY_RUNNING)
    except ConfigError as error:
        return _fail(error, EXIT_CONFIG)
    except ModuleNotFoundError as error:
        if error.name and error.name.split(".")[0] in ("common", "onboard", "ground", "simulation"):
            raise
        return _fail(
            f"{spec.name} needs the module {error.name!r}, which is not installed: "
            f"pip install 'outrider[{spec.extra}]'",
            EXIT_CONFIG,
        )


def run_side(side: Side, arguments: Sequence[str], without: Sequence[str] = ()) -> int:
    """Run all processes of a side under a supervisor until a signal ends it; returns the exit code.

    Args:
        side: which side.
        arguments: passed to each process (`--config …`, `--set …`).
        without: names of processes to leave out.

    Raises:
        ConfigError: a name in `without` is no process of this side.
    """
    specs = side_processes(side)
    for name in without:
        if name not in {s.name for s in specs}:
            raise ConfigError(f"--without: got {name!r}, expected one of: {', '.join(s.name for s in specs)}")
    stop, _ = stop_on_signals()
    return Supervisor([s for s in specs if s.name not in without], arguments).run(stop)


def _fail(error: object, code: int) -> int:
    log.error("%s", error)
    return code
