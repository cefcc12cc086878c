"""A node as a process of its own: `python -m tests.browser.node_process NAME '<tables as JSON>'`."""

from __future__ import annotations

import json
import sys

from common.config import Config
from common.launch import run_process, set_up_logging
from common.processes import SECTIONS, process


def main() -> int:
    """Run the node until a signal ends it; returns its exit code."""
    name, tables = sys.argv[1], json.loads(sys.argv[2])
    set_up_logging(name)
    sections = {section: SECTIONS[section] for section in {"bus", "camera", *tables}}
    return run_process(process(name), Config(tables, sections, "test"))


if __name__ == "__main__":
    sys.exit(main())
