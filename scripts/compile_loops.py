"""Compiles every loop that Numba keeps on disk, once: `scripts/setup.sh` calls this.

Else whoever imports one first compiles it, and so do all processes that start beside that one. What is compiled already
and has not changed costs its import alone. `NUMBA_CACHE_DIR` says where it is kept; without it, beside the code.
"""

from __future__ import annotations

import importlib
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("common", "onboard", "ground", "simulation", "benchmarks")


def modules() -> list[str]:
    """Names of the modules that have such loops, the largest first."""
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py") if "@njit" in path.read_text()]
    paths.sort(key=lambda path: -path.stat().st_size)
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths]


def compile_module(name: str) -> str:
    """Import a module, which compiles its loops; returns its name."""
    importlib.import_module(name)
    return name


def main() -> None:
    """Compile all of them, on all cores."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for name in pool.map(compile_module, modules()):
            print(f"compiled {name}")


if __name__ == "__main__":
    main()
