"""librealsense's own filters give the pixels of ours, on depth of a real D415."""

from __future__ import annotations

import platform
from pathlib import Path

import pytest

# Version 2.55 fills other holes in the spatial filter. The module has a version from 2.58 on.
pytest.importorskip("pyrealsense2", minversion="2.58", exc_type=ImportError)

from tests import script

filters = script.load("benchmarks/simulation/vendor_filters.py")
ROOMS = 2
LARGEST_SHARE = 0.0 if platform.machine() == "x86_64" else 1e-4  # As for simulated depth.


@pytest.mark.long
def test_filters_give_the_vendors_pixels_on_real_depth(captures: Path) -> None:
    folder = captures / "d415-faro"
    if not folder.is_dir():
        pytest.skip(f"no captures at {folder}")
    rooms = list(filters.captured(str(folder), ROOMS))
    assert len(rooms) == ROOMS
    for name, settings in filters.SETTINGS.items():
        for codes, sensor in rooms:
            unequal, pixels, _ = filters.compare(codes, filters.with_post(sensor, settings))
            assert unequal <= LARGEST_SHARE * pixels, name
