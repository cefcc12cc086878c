"""The console as a process of its own: `python -m tests.browser.console_process '<tables as JSON>'`."""

from __future__ import annotations

import json
import sys

from common.config import Config
from common.launch import run_process, set_up_logging
from common.processes import SECTIONS, process


def main() -> int:
    """Run the console until a signal ends it; returns its exit code."""
    set_up_logging("console")
    config = Config(json.loads(sys.argv[1]), {name: SECTIONS[name] for name in ("bus", "console", "camera")}, "test")
    return run_process(process("console"), config)


if __name__ == "__main__":
    sys.exit(main())
