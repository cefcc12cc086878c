"""The rules of the layout, read from the source: who may import whom, and where keys and truth may be named."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
ALLOWED = {
    "common": {"common"},
    "onboard": {"common", "onboard"},
    "ground": {"common", "ground"},
    "simulation": {"common", "simulation"},
    "benchmarks": {"common", "onboard", "ground", "simulation", "benchmarks"},
}
LIBRARIES = {
    # Session and bus alone speak Zenoh; the other two name its type of a raw sample.
    "zenoh": (
        "common/session.py",
        "common/bus.py",
        "common/subscription.py",
        "common/topics_tool.py",
        "ground/recorder/process.py",
    ),
    "mavsdk": ("onboard/helm/",),
    "pymavlink": ("simulation/", "benchmarks/"),
    "mujoco": ("simulation/world/", "benchmarks/"),
    "viser": ("ground/console/",),
    "mcap": ("common/recording.py",),
    "matplotlib": ("benchmarks/", "common/evaluation_plot.py"),
    "filterpy": ("onboard/fusion/", "benchmarks/"),
}
# Shells talk to the bus, a device or an operator; everything else in a capability's folder is an algorithm or data.
SHELLS = (
    "node.py",
    "process.py",
    "simulation/conformance/",  # speaks MAVLink to an autopilot
    "onboard/helm/autopilot_link.py",  # MAVSDK
    "onboard/camera/source.py",  # cameras
    "onboard/fusion/members.py",  # the trackers' processes
    "onboard/follow/choice.py",  # a command, and how long the loop may wait
    "onboard/camera/stream.py",  # what the node sends
    "ground/recorder/intake.py",  # the queue between threads
    "ground/console/",  # all of it is the operator's page
    "onboard/doctor/",  # looks at devices, ports and the bus
    "ground/doctor/",
    "simulation/doctor/",
    "simulation/demo/",  # starts processes, flies the demonstration
    "simulation/world/truth_port.py",  # MAVLink
    "simulation/world/gl.py",  # the renderer's driver
    "simulation/autopilot/link.py",
    "simulation/autopilot/mavlink.py",
    "simulation/autopilot/commands.py",
    "simulation/autopilot/telemetry.py",
    "simulation/autopilot/status.py",
    "simulation/autopilot/rates.py",  # MAVLink
)
CAPABILITIES = ("common/geometry/", "common/tracking/", "onboard/", "ground/", "simulation/")
# What would tie an algorithm to the bus, a device, or the time of day.
NOT_FOR_ALGORITHMS = {
    "common.session",
    "common.bus",
    "common.subscription",
    "common.node",
    "common.runner",
    "common.launch",
    "common.recording",
    "zenoh",
    "mavsdk",
    "pymavlink",
    "viser",
    "socket",
    "subprocess",
    "threading",
    "time",
    "datetime",
}
# Settings that a library reads when it is first imported have to stand before that import.
RUNS_AT_IMPORT = ("common/__init__.py", "simulation/world/gl.py")
"""What libraries look up once, while they are loaded, must be set before that."""
# They take half a second of a core and 70 MB each, and every process of a vehicle reads all settings.
SLOW_TO_LOAD = ("scipy", "filterpy", "numba", "matplotlib", "mavsdk", "mujoco", "viser")
LONGEST_FILE = 400
LONGEST_FUNCTION = 70


def modules() -> list[str]:
    """Every module of the distribution, as a path from the root."""
    return sorted(str(p.relative_to(ROOT)) for root in ALLOWED for p in (ROOT / root).rglob("*.py"))


@cache
def tree_of(module: str) -> ast.Module:
    """Syntax tree of a module."""
    return ast.parse((ROOT / module).read_text(encoding="utf-8"), module)


@cache
def imports(module: str) -> frozenset[str]:
    """Full names of everything that a module imports, at its top or inside a function."""
    return frozenset(_imported(module))


def _imported(module: str) -> Iterator[str]:
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}:{node.lineno}: relative import; write the full name"
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def texts(module: str) -> Iterator[tuple[int, str]]:
    """Line and content of every text in a module, docstrings left out."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {
        id(n.body[0].value)
        for n in ast.walk(tree_of(module))
        if isinstance(n, documented) and n.body and isinstance(n.body[0], ast.Expr)
    }
    # A text on its own below a field is that field's docstring.
    docstrings |= {id(n.value) for n in ast.walk(tree_of(module)) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.lineno, node.value


def is_algorithm(module: str) -> bool:
    """Whether a module has to be free of bus, devices and clocks."""
    in_capability = any(module.startswith(folder) for folder in CAPABILITIES)
    return in_capability and not any(
        module.startswith(s) if s.endswith("/") else module == s or Path(module).name == s for s in SHELLS
    )


def test_the_modules_are_found() -> None:
    found = modules()

    assert {"common/bus.py", "onboard/limiter/law.py", "ground/recorder/process.py"} <= set(found)
    assert sum(map(is_algorithm, found)) > 15


def broken(rule: Callable[[str], object], among: Iterable[str]) -> dict[str, object]:
    """What a rule finds wrong, by module; one test for all modules, since one for each costs more than its look."""
    return {module: wrong for module in among if (wrong := rule(module))}


def test_sides_do_not_know_each_other() -> None:
    def strangers(module: str) -> set[str]:
        known = {name.split(".")[0] for name in imports(module)} & {*ALLOWED, "tests"}
        return known - ALLOWED[module.split("/")[0]]

    assert not broken(strangers, modules()), f"each may import these only: {ALLOWED}"


def test_libraries_stay_where_they_belong() -> None:
    def elsewhere(module: str) -> set[str]:
        libraries = {name.split(".")[0] for name in imports(module)} & set(LIBRARIES)
        return {library for library in libraries if not module.startswith(LIBRARIES[library])}

    assert not broken(elsewhere, modules()), f"each is for its places alone: {LIBRARIES}"


def test_algorithms_know_no_bus_no_device_and_no_clock() -> None:
    def worldly(module: str) -> set[str]:
        return {n for n in imports(module) if n in NOT_FOR_ALGORITHMS or n.split(".")[0] in NOT_FOR_ALGORITHMS}

    wrong = broken(worldly, filter(is_algorithm, modules()))
    assert not wrong, "pass in what it needs (arrays, t_ns, rng), or, if this is a shell, name it in SHELLS"


def test_randomness_is_seeded_and_passed_in() -> None:
    """No global generator, neither Python's nor NumPy's."""

    def unseeded(module: str) -> list[str]:
        nodes = (n for n in ast.walk(tree_of(module)) if isinstance(n, ast.Attribute | ast.Call))
        return [f"line {node.lineno}" for node in nodes if _is_global_or_unseeded(node)]

    assert not broken(unseeded, modules())


def _is_global_or_unseeded(node: ast.Attribute | ast.Call) -> bool:
    if isinstance(node, ast.Call):
        return _dotted(node.func).endswith(("random.Random", "default_rng")) and not node.args
    of_random = _dotted(node.value) in ("random", "np.random", "numpy.random")
    return of_random and node.attr not in ("Random", "Generator", "default_rng", "SeedSequence", "PCG64")


def _dotted(node: ast.AST) -> str:
    """Names of an expression that is nothing but names with dots between; empty for any other."""
    if isinstance(node, ast.Attribute):
        before = _dotted(node.value)
        return f"{before}.{node.attr}" if before else ""
    return node.id if isinstance(node, ast.Name) else ""


def test_keys_are_written_in_one_place() -> None:
    def keys(module: str) -> list[tuple[int, str]]:
        return [(line, text) for line, text in texts(module) if "outrider/" in text]

    wrong = broken(keys, (m for m in modules() if m != "common/topics.py"))
    assert not wrong, "name the topic and let common.topics.key make the key"


def test_no_algorithm_can_see_the_truth() -> None:
    def seeing(module: str) -> list[object]:
        names = {n.attr for n in ast.walk(tree_of(module)) if isinstance(n, ast.Attribute)}
        imported = {"common.truth"} & imports(module)
        return [*imported, *({"Truth"} & names), *(line for line, text in texts(module) if text == "truth")]

    assert not broken(seeing, (m for m in modules() if m.startswith(("onboard/", "ground/"))))


def test_files_and_functions_stay_readable() -> None:
    def long(module: str) -> list[str]:
        lines = (ROOT / module).read_text(encoding="utf-8").count("\n")
        found = [f"{lines} lines: split it"] if lines > LONGEST_FILE else []
        for node in ast.walk(tree_of(module)):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                found += [f"{node.name}: {length} lines"] if length > LONGEST_FUNCTION else []
        return found

    assert not broken(long, modules())


def test_nothing_runs_at_import() -> None:
    """A module's top level holds definitions, constants and imports, and begins with a docstring."""

    def running(module: str) -> list[str]:
        body = tree_of(module).body
        undocumented = ["no docstring"] if body and not ast.get_docstring(tree_of(module)) else []
        return undocumented + [f"line {node.lineno}" for node in body if not _only_defines(node)]

    assert not broken(running, (m for m in modules() if m not in RUNS_AT_IMPORT))


def _only_defines(node: ast.stmt) -> bool:
    allowed = (
        ast.Import,
        ast.ImportFrom,
        ast.FunctionDef,
        ast.AsyncFunctionDef,
        ast.ClassDef,
        ast.Assign,
        ast.AnnAssign,
    )
    documentation = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    condition = ast.unparse(node.test) if isinstance(node, ast.If) else ""
    return isinstance(node, allowed) or documentation or condition in ("__name__ == '__main__'", "TYPE_CHECKING")


def test_commands_and_settings_load_nothing_slow() -> None:
    """By their own process: this one has loaded everything already."""
    script = (
        "import sys, common.cli; from common.processes import load_config; load_config('kite'); print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)

    slow = {name.split(".")[0] for name in loaded.stdout.split()} & set(SLOW_TO_LOAD)
    assert not slow, "import it where it is used, or put the settings into a module of their own"
