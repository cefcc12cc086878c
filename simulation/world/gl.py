"""The headless OpenGL context that MuJoCo draws in, and the one line of advice when there is none."""

from __future__ import annotations

import importlib
import logging
import os
from typing import Any

from common.config import ConfigError

_PACKAGES = "libegl1 and libgl1-mesa-dri"


class GlMissingError(ConfigError):
    """No headless OpenGL on this machine; the text names the packages to install."""


def _missing(error: BaseException) -> GlMissingError:
    detail = " ".join(str(error).split())[:160] or type(error).__name__
    return GlMissingError(
        f"got no headless OpenGL ({detail}); expected EGL with a software or hardware driver; "
        f"install the packages {_PACKAGES} (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri)"
    )


def _load() -> Any:
    logging.getLogger("OpenGL").setLevel(logging.WARNING)  # it reports an optional accelerator at each start
    try:
        module = importlib.import_module("mujoco")
        importlib.import_module("mujoco.gl_context")
    except ModuleNotFoundError:
        raise
    except Exception as error:  # noqa: BLE001  PyOpenGL raises by what exactly is missing: ImportError, AttributeError, …
        raise _missing(error) from None
    return module


# MuJoCo and Mesa read their settings when they are first imported, so this stands before the import, and every module
# of this folder takes `mujoco` from here. One rasteriser thread: more only take cores from the other processes.
# It is `Any` because the package has no types that a checker could read.
os.environ.setdefault("MUJOCO_GL", "egl")
os.environ.setdefault("LP_NUM_THREADS", "1")
mujoco: Any = _load()


def open_context(width: int, height: int) -> Any:
    """Current OpenGL context without a window; free it with its `free()`.

    Args:
        width: columns of the largest picture, px.
        height: rows of the largest picture, px.

    Raises:
        GlMissingError: EGL or its driver is not installed.
    """
    try:
        context = mujoco.gl_context.GLContext(width, height)
        context.make_current()
    except Exception as error:  # noqa: BLE001  as above
        raise _missing(error) from None
    return context
