"""The module `pyrealsense2`, as `Any` because it has no types."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from starling.patterns import errors

try:
    rs: Any = import_module("pyrealsense2")
except ModuleNotFoundError:
    raise errors.needs("starling.realsense", "pyrealsense2", "realsense") from None
except ImportError as error:  # Its own libraries are missing.
    raise errors.refuse(
        "pyrealsense2", "must load", error, "On Debian: apt-get install libusb-1.0-0."
    ) from None
