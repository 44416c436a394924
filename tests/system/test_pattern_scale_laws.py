"""Laws of the pattern's scale: direction cosines grow in proportion, energy is kept.

Rationale: a diffractive element has its order m at sin t = m lambda / period. A wavelength longer
by the factor 1 + e therefore scales all direction cosines by 1 + e. The power of each order is
unchanged. Expected values are derived by hand.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from starling.patterns import Pattern
from starling.patterns.field import Field
from starling.sim.render import direct, emission
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.sensor import presets
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo import structured_light

SIZE = {"width": 640, "height": 320, "cx_px": 319.5, "cy_px": 159.5}


def camera(focal_px: float, **light: Any) -> Sensor:
    """A camera with one emitter at the left imager."""
    preset = presets.load("d415")
    part = dataclasses.replace(preset.projector, position_m=(0.0, 0.0, 0.0), emitters=())
    part = dataclasses.replace(part, **light)
    return dataclasses.replace(preset, **SIZE, fx_px=focal_px, fy_px=focal_px, projector=part)


def scaled(sensor: Sensor, scale: float) -> Sensor:
    part = dataclasses.replace(sensor.projector, pattern_scale=scale)
    return dataclasses.replace(sensor, projector=part)


def lit(sensor: Sensor, distance_m: float = 1.0) -> np.ndarray:
    layers = direct.layers(MitsubaScene(scenes.wall(distance_m)), sensor)
    return layers.left.projector_direct.astype(np.float64)


@pytest.fixture
def dots(monkeypatch: pytest.MonkeyPatch) -> Sensor:
    """Five dots on a row, out to 35 degrees in a field of 100, 3 px wide."""

    def make(*, fov_x_deg: float, fov_y_deg: float, seed: int) -> Pattern:
        x = np.tan(np.deg2rad(DOTS_DEG))
        return Pattern.from_dots(
            x,
            0 * x,
            0 * x + 1,
            field=Field(fov_x_deg, fov_y_deg),
            width_px=3200,
            fwhm_mrad=8.0,
            background=0.0,
            name=f"dots, seed {seed}",
        )

    monkeypatch.setitem(emission.GENERATORS, "dots", make)
    return camera(400.0, pattern="dots", fov_x_deg=100.0, fov_y_deg=40.0)


DOTS_DEG = np.array([-35.0, -20.0, 5.0, 20.0, 35.0])


def columns_px(image: np.ndarray, near_px: np.ndarray) -> np.ndarray:
    """Centroids of dots within 15 px of the given positions."""
    profile, measured = image.sum(axis=0), []
    for near in np.rint(near_px).astype(int):
        window = np.arange(max(near - 15, 0), near + 16)
        measured.append((profile[window] * window).sum() / profile[window].sum())
    return np.array(measured)


@pytest.mark.parametrize("scale", [0.97, 0.997, 1.003, 1.03])
def test_dots_move_in_proportion_to_their_direction_cosine(dots: Sensor, scale: float) -> None:
    """sin t = s sin t0, to 0.02 px (4.2 px at 35 degrees for 1 %), at two distances.

    Does not prove that a device's projector is diffractive; an image projected by a lens would not
    grow with the wavelength.
    """
    for distance_m in (0.5, 2.0):
        home, moved = (
            np.tan(np.arcsin(s * np.sin(np.deg2rad(DOTS_DEG)))) * 400.0 + SIZE["cx_px"]
            for s in (1.0, scale)
        )
        still = columns_px(lit(dots, distance_m), home)
        measured = columns_px(lit(scaled(dots, scale), distance_m), moved)
        np.testing.assert_allclose(measured - still, moved - home, atol=0.02)


@pytest.mark.parametrize("scale", [0.95, 0.995, 1.005, 1.05])
def test_no_light_is_lost_or_made(dots: Sensor, scale: float) -> None:
    """The total light on a plane across the axis is unchanged to 0.1 %.

    A fronto-parallel wall is that plane. Pixels cover equal areas, and radiance is proportional to
    irradiance.
    """
    total = lit(dots).sum()
    assert lit(scaled(dots, scale)).sum() == pytest.approx(total, rel=1e-3)


@pytest.fixture
def even(tmp_path: Path) -> Sensor:
    cv2.imwrite(str(tmp_path / "even.png"), np.full((64, 96), 200, np.uint8))
    return camera(250.0, pattern=str(tmp_path / "even.png"), fov_x_deg=90.0, fov_y_deg=60.0)


@pytest.mark.parametrize("scale", [0.96, 1.004, 1.04])
def test_even_light_changes_by_the_laws_factor(even: Sensor, scale: float) -> None:
    """E / E0 = (cos t / cos t0)^4 / s^2 to 2e-5, and the field's edge is at s times its cosine.

    Does not cover the element's efficiency, which is assumed to be independent of wavelength.
    """
    before, after = lit(even), lit(scaled(even, scale))
    rows, columns = np.indices(before.shape)
    x, y = (columns - SIZE["cx_px"]) / 250.0, (rows - SIZE["cy_px"]) / 250.0
    far = 1 + x**2 + y**2
    a, b = x / np.sqrt(far) / scale, y / np.sqrt(far) / scale
    nominal_cos = np.sqrt(1 - a**2 - b**2)
    expected = (1 / far / nominal_cos**2) ** 2 / scale**2
    half_x, half_y = emission.half_tangents(even.projector)
    inside = np.maximum(abs(a / nominal_cos) / half_x, abs(b / nominal_cos) / half_y)
    # Two pixels inside the edges of both fields. Sub-pixel means add an error by curvature.
    deep = (inside < 0.98) & (abs(x) < 0.98 * half_x) & (abs(y) < 0.98 * half_y)
    np.testing.assert_allclose(after[deep] / before[deep], expected[deep], rtol=2e-5)
    assert (after[inside < 0.99] > 0).all() and not after[inside > 1.01].any()


def test_all_emitters_scale_about_their_own_axes(dots: Sensor) -> None:
    """In its own frame each emitter's pattern scales like that of a single emitter."""
    turn_deg, offset = (0.0, 4.0, 0.0), (0.02, 0.0, 0.0)
    emitters = (Emitter(offset_m=offset, rotation_deg=turn_deg),)
    with_emitter = dataclasses.replace(dots.projector, emitters=emitters, pattern_scale=1.02)
    alone = dataclasses.replace(
        dots.projector, position_m=offset, rotation_deg=turn_deg, pattern_scale=1.02
    )
    first, second = (lit(dataclasses.replace(dots, projector=p)) for p in (with_emitter, alone))
    np.testing.assert_allclose(first, second, rtol=2e-3, atol=1e-4 * second.max())


def test_pattern_scale_is_continuous_at_neutral(even: Sensor) -> None:
    """The shortcut at neutral gives the same numbers as the general code."""
    np.testing.assert_allclose(lit(scaled(even, 1 + 1e-9)), lit(even), rtol=2e-6)


def test_structured_lights_reference_keeps_its_scale() -> None:
    kinect = presets.load("kinect-v1")
    assert np.array_equal(
        structured_light.reference_image(kinect),
        structured_light.reference_image(scaled(kinect, 1.003)),
    )
