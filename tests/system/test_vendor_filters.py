"""librealsense's own filters give the pixels of ours, on the same simulated depth."""

from __future__ import annotations

import platform
from typing import Any

import pytest

import starling

# Version 2.55 fills other holes in the spatial filter. The module has a version from 2.58 on.
pytest.importorskip("pyrealsense2", minversion="2.58", exc_type=ImportError)

from tests import script

pytestmark = pytest.mark.slow

filters = script.load("benchmarks/simulation/vendor_filters.py")
SENSOR = starling.load_sensor("d435", mode="424x240")
SCENES = {"clutter:1": 0, "tabletop:2": 1, "room:3": 2}  # With the seeds of their noise.
# Other compilers fuse multiplication and addition, which moves few pixels by a depth unit.
LARGEST_SHARE = 0.0 if platform.machine() == "x86_64" else 1e-4


@pytest.fixture(scope="module", params=SCENES)
def codes(request: pytest.FixtureRequest) -> list[Any]:
    return filters.simulated(request.param, SENSOR, seed=SCENES[request.param])


def test_frames_hold_what_the_filters_change(codes: list[Any]) -> None:
    """Holes, edges and noise; otherwise equal pixels would prove little."""
    holes = [1 - (code > 0).mean() for code in codes]
    assert min(holes) > 0.01 and max(holes) < 0.5
    assert all((codes[0] != code).any() for code in codes[1:])


@pytest.mark.parametrize("name", filters.SETTINGS)
def test_filters_give_the_vendors_pixels(name: str, codes: list[Any]) -> None:
    sensor = filters.with_post(SENSOR, filters.SETTINGS[name])
    unequal, pixels, _ = filters.compare(codes, sensor)
    assert unequal <= LARGEST_SHARE * pixels
    changed = filters.ours(codes, sensor)
    assert any((ours != code).any() for ours, code in zip(changed, codes, strict=True))


@pytest.mark.parametrize("unit_m", [1e-4, 5e-4])
def test_other_depth_units_give_the_vendors_pixels(unit_m: float, codes: list[Any]) -> None:
    """Codes stay, so depth is nearer and disparities are larger."""
    sensor = starling.load_sensor("d435", mode="424x240", edits=[f"post.depth_unit_m={unit_m}"])
    for name in ("spatial 0.5, 20, 2", "temporal 0.4, 20, 3", "chain 2", "chain 3"):
        settings = {**filters.SETTINGS[name], "near_m": 0.01, "far_m": 16.0}
        unequal, pixels, _ = filters.compare(codes, filters.with_post(sensor, settings))
        assert unequal <= LARGEST_SHARE * pixels
