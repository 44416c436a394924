"""No depth where there is no light: objects alone in space, for all stock sensors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from starling.sim.corrupt import Corruptor
from starling.sim.sensor import edits, presets
from tests import script

MOST = 0.01  # Largest share of the frame with depth, but without surface.
HALF_WINDOW_PX = 7
BLUR_PX = 1  # Light of the object reaches further by this much.
# Metering of a nearly black frame would fill the box's pixels, which have no texture then.
EXPOSURE = ("imager.auto_exposure_level=0", "imager.exposure_s=0.001")
WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
MATRIX = np.array([[FOCAL, 0, 159.5], [0, FOCAL, 119.5], [0, 0, 1]])


ACTIVE = [name for name in presets.names() if presets.load(name).projector.power_w]
PASSIVE = sorted(set(presets.names()) - set(ACTIVE))


def box_alone() -> np.ndarray:
    """Depth (h, w) of the front of a box at 0.8 m, without background [m]."""
    depth = np.full((HEIGHT, WIDTH), np.nan, np.float32)
    depth[90:150, 140:200] = 0.8
    return depth


def false_depth(name: str, *changes: str) -> tuple[float, float, float]:
    """Share of false depth, its largest distance from the box [px], and fill of the box."""
    sensor = edits.with_camera(presets.load(name), MATRIX, (WIDTH, HEIGHT))
    depth = box_alone()
    surface = np.isfinite(depth)
    seen = np.isfinite(Corruptor(edits.apply(sensor, (*EXPOSURE, *changes)), MATRIX)(depth).depth_m)
    away = cv2.distanceTransform((~surface).astype(np.uint8), cv2.DIST_C, cv2.DIST_MASK_5)
    false = seen & ~surface
    return float(false.mean()), float(away[false].max(initial=0)), float(seen[surface].mean())


@pytest.mark.parametrize("name", ACTIVE)
def test_a_box_alone_has_no_depth_around_it(name: str) -> None:
    share, away_px, fill = false_depth(name)
    assert share <= MOST and away_px <= HALF_WINDOW_PX
    assert fill > 0.85


@pytest.mark.parametrize("name", PASSIVE)
def test_passive_cameras_have_little_depth_beside_a_box(name: str) -> None:
    share, _, _ = false_depth(name)
    assert share <= MOST


@pytest.mark.parametrize(
    "changes",
    [
        ("imager.gain=8.0",),
        ("imager.black_level_dn=4.125",),
        ("imager.read_noise_e=20.0",),
        ("imager.row_noise_e=10.0",),
        ("imager.column_noise_e=10.0",),
        ("imager.dark_current_e_s=100000.0",),
        ("imager.lens.veil=0.02",),
    ],
)
def test_no_noise_of_an_imager_has_depth(changes: tuple[str, ...]) -> None:
    share, away_px, fill = false_depth("d435", *changes)
    assert share <= MOST and away_px <= HALF_WINDOW_PX
    assert fill > 0.85


def test_the_check_removes_depth_far_from_the_box() -> None:
    """Without it the disparity of the box spreads: windows of noise have texture enough."""
    share, away_px, _ = false_depth("d435", "matcher.checks.dark_noise=0.0")
    assert share > 5 * MOST and away_px > 50


@pytest.mark.long
@pytest.mark.parametrize("name", ACTIVE)
@pytest.mark.parametrize("label", ["box", "duck", "arm"])
def test_objects_alone_have_no_depth_around_them(name: str, label: str) -> None:
    """In the sensor's own mode; the arm is a chain of cylinders and boxes with a gripper."""
    benchmark = script.load("benchmarks/matcher/empty_space.py")
    (shot,) = benchmark.shots(benchmark.OBJECTS[label](), presets.load(name))
    figures = benchmark.measure(shot)
    assert figures.false <= MOST
    assert figures.farthest_px <= HALF_WINDOW_PX + BLUR_PX
    assert figures.fill > 0.85
