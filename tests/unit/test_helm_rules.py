"""Rules of helm that hold for the source itself."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

_ROOT = Path(__file__).parents[2]
_PURE = sorted(
    {*(_ROOT / "onboard/limiter").glob("*.py"), *(_ROOT / "onboard/helm").rglob("*.py")}
    - {_ROOT / "onboard/helm" / name for name in ("node.py", "autopilot_link.py", "lock.py")}
)
_SOURCES = [p for side in ("common", "onboard", "ground") for p in (_ROOT / side).rglob("*.py")]


def _imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


@pytest.mark.parametrize("path", _PURE, ids=lambda p: p.name)
def test_arbiter_limiter_and_flight_import_neither_mavsdk_nor_the_bus(path: Path):
    for name in _imports(path):
        assert not name.startswith(("mavsdk", "pymavlink", "zenoh", "common.bus", "common.node", "common.runner")), name


def test_one_module_alone_talks_to_the_autopilot():
    speakers = {
        p.relative_to(_ROOT).as_posix()
        for p in _SOURCES
        if any(name.split(".")[0] in ("mavsdk", "pymavlink") for name in _imports(p))
    }
    assert speakers == {"onboard/helm/autopilot_link.py"}


def test_neither_the_offboard_plugin_nor_a_forced_arming_is_used():
    """The plugin would stream the last setpoint on while Python hangs; `arm_force` sends a forced disarm."""
    path = _ROOT / "onboard/helm/autopilot_link.py"
    assert not any("offboard" in name.lower() for name in _imports(path))
    called = {
        node.attr for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Attribute)
    }
    assert "arm_force" not in called and "arm_force_async" not in called


def test_nothing_outside_the_dialects_knows_which_autopilot_it_flies():
    """None of their words; configuration alone names their parameters."""
    words = re.compile(r"PX4|ArduPilot|ARDUPILOT|OFFBOARD|GUIDED|COM_O|MIS_TAKEOFF")
    allowed = {"config.py"}
    for path in (_ROOT / "onboard/helm").glob("*.py"):
        if path.name not in allowed:
            assert not words.findall(path.read_text(encoding="utf-8")), path.name
