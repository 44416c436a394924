"""The package `mujoco`, loaded on use, and its context for drawing."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator
from typing import Any

from starling.patterns import errors


def mujoco() -> Any:
    """Return the module `mujoco`.

    Raises:
        InputError: if it is not installed.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise errors.needs("starling.mujoco", "mujoco", "mujoco") from None


def gl_context(width: int, height: int) -> Any:
    """Open a context of OpenGL; without a display by EGL, unless MUJOCO_GL chooses.

    MuJoCo's own choice is made when it is imported, and needs a display by default.

    Raises:
        InputError: if MuJoCo cannot draw on this machine.
    """
    library = mujoco()
    shown = any(os.environ.get(name) for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"))
    try:
        module = library if shown else importlib.import_module("mujoco.egl")
        context = module.GLContext(width, height)
        with current(context):
            pass
    except Exception as error:  # Drivers raise errors of many types.
        advice = "Debian: apt-get install libegl1 libgl1-mesa-dri, or set MUJOCO_GL=osmesa."
        advice += " by='trace' needs no OpenGL."
        raise errors.refuse("MuJoCo", "must be able to draw", str(error), advice) from None
    return context


@contextlib.contextmanager
def current(context: Any) -> Iterator[None]:
    """Draw in a context of OpenGL, and leave it free for other threads.

    A context that stays current in one thread is refused by all others. In releases of MuJoCo
    without `as_current` it stays in the thread that draws first.
    """
    if not hasattr(context, "as_current"):
        context.make_current()
        yield
        return
    with context.as_current():
        yield
