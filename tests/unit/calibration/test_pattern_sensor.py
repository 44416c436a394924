"""A recovered pattern in a sensor: pattern images on disk, emitter positions."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

from starling.calibration.pattern import pattern_sensor
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emission import RightAlignment
from starling.calibration.pattern.emitter_model import EmitterModel, PatternEmitter
from starling.calibration.pattern.image_recovery import imager_blur_px
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import PatternFit
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.pattern.unprojected import PatternImage
from starling.patterns.field import Field
from starling.sim.captures import png
from starling.sim.geometry import frames
from starling.sim.render import emission
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

GRID = Grid(half_a=0.66, half_b=0.46, step=2e-3)


def _image() -> PatternImage:
    """Return a smooth image without symmetry, with invalid values at an uncovered edge."""
    rng = np.random.default_rng(2)
    value = cv2.GaussianBlur(rng.standard_normal(GRID.shape), (0, 0), 3.0)
    value /= value.std()
    sd = np.full(GRID.shape, 0.1, np.float32)
    sd[:, -15:] = np.inf
    value[:, -15:] = 50
    return PatternImage(grid=GRID, value=value.astype(np.float32), sd=sd, views=sd)


def _lattice(angle_deg: float, sigma: float = 2.5e-3) -> Lattice:
    angle = np.radians(angle_deg)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Lattice(frequencies=turn / 0.03, phase=np.array([0.15, -0.3]), sigma=sigma)


def _recovered(*sources: Lattice | PatternImage) -> RecoveredPattern:
    places = np.array([[0.026, 0.001, -0.001], [0.0305, 0.0, 0.001]])
    model = EmitterModel(
        emitters=tuple(
            PatternEmitter(position_m=place, source=source)
            for place, source in zip(places, sources, strict=False)
        ),
        rotation_deg=(2.0, -3.0, 1.0),
        scales={"a": 1.0},
        alignment=RightAlignment(offset_y=0.4, roll=0.8, offset_x=0.3, focal_baseline=0.09),
    )
    fitted = PatternFit(
        model=model,
        covariance=np.eye(len(model.names)),
        cost=(1.0,),
        shares=np.array([0.6, 0.4])[: len(sources)],
    )
    return RecoveredPattern(fitted=fitted, image=_image())


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return presets.load("d415")


def _read(path: str) -> np.ndarray:
    return np.asarray(png.read(Path(path), "pattern"), np.float64)


def _light_at(image: np.ndarray, slopes: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Sample a written pattern at tangents (n, 2)."""
    field = Field(sensor.projector.fov_x_deg, sensor.projector.fov_y_deg)
    x, y = field.pixels(slopes[:, 0], slopes[:, 1], (image.shape[0], image.shape[1]))
    return ndimage.map_coordinates(image, [y, x], order=1, mode="nearest")


def _inside(cosines: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Select directions well inside the projector's field."""
    slopes = cosines / np.sqrt(1 - (cosines**2).sum(axis=1))[:, None]
    return (np.abs(slopes) < 0.95 * np.array(emission.half_tangents(sensor.projector))).all(axis=1)


def test_emitters_have_their_fitted_positions(sensor: Sensor, tmp_path: Path) -> None:
    recovered = _recovered(_lattice(49.0), _lattice(60.0))
    light = pattern_sensor.with_pattern(sensor, recovered, tmp_path).projector
    assert light.rotation_deg == recovered.model.rotation_deg
    for emitter, fitted_emitter in zip(light.emitters, recovered.model.emitters, strict=True):
        place = np.array(light.position_m) + frames.rotation(light.rotation_deg) @ np.array(
            emitter.offset_m
        )
        np.testing.assert_allclose(place, fitted_emitter.position_m, atol=1e-12)
    assert [emitter.power_share for emitter in light.emitters] == [0.6, 0.4]
    assert [Path(emitter.pattern).name for emitter in light.emitters] == [
        "emitter-0.png",
        "emitter-1.png",
    ]
    assert all(Path(emitter.pattern).is_file() for emitter in light.emitters)


def test_a_lattices_dots_are_drawn_at_their_positions(sensor: Sensor, tmp_path: Path) -> None:
    """The pattern is bright at each dot and dark half-way between dots; its mirror is not."""
    source = _lattice(49.0)
    drawn = pattern_sensor.with_pattern(sensor, _recovered(source), tmp_path)
    image = _read(drawn.projector.emitters[0].pattern)
    cosines = source.dots(0.6, 0.4)
    cosines = cosines[_inside(cosines, sensor)]
    between = cosines + source.pitch @ np.array([0.5, 0.5])
    far = np.sqrt(1 - (cosines**2).sum(axis=1))[:, None]
    bright = _light_at(image, cosines / far, sensor)
    # Off-axis dots of equal power are larger and dimmer in the plane, by cos^4.
    expected = bright.max() * far[:, 0] ** 4
    np.testing.assert_allclose(bright / expected, 1, atol=0.15)
    dark = _light_at(image, between / np.sqrt(1 - (between**2).sum(axis=1))[:, None], sensor)
    assert dark.max() < 0.05 * bright.max()
    turned = _light_at(image[:, ::-1], cosines / far, sensor)
    assert np.mean(turned > 0.5 * expected) < 0.5


def test_drawn_dots_exclude_the_imagers_blur(sensor: Sensor, tmp_path: Path) -> None:
    """The drawn width is the observed width minus blur in quadrature, at least 1 mrad."""
    blur = imager_blur_px(sensor) / sensor.fx_px
    for sigma, drawn_mrad in ((2e-3, 2.0), (0.2e-3, 1.0)):
        source = dataclasses.replace(
            _lattice(0.0, sigma=float(np.hypot(sigma, blur))), phase=np.zeros(2)
        )
        drawn = pattern_sensor.with_pattern(sensor, _recovered(source), tmp_path)
        image = _read(drawn.projector.emitters[0].pattern)
        samples = np.array([[0.0, 0.0], [drawn_mrad * 1e-3, 0.0]])
        middle, side = _light_at(image, samples, sensor)
        assert side / middle == pytest.approx(np.exp(-0.5), abs=0.08)


def test_an_image_is_resampled_into_the_field(sensor: Sensor, tmp_path: Path) -> None:
    """The resampled image matches up to gain and offset; uncovered directions are dark."""
    source = _image()
    drawn = pattern_sensor.with_pattern(sensor, _recovered(source), tmp_path)
    image = _read(drawn.projector.emitters[0].pattern)
    a, b = GRID.cosines()
    cosines = np.stack(np.meshgrid(a[20:-20], b[20:-20]), axis=-1).reshape(-1, 2)
    value = source.value[20:-20, 20:-20].ravel()
    inside = _inside(cosines, sensor)
    slopes = cosines / np.sqrt(1 - (cosines**2).sum(axis=1))[:, None]
    seen = _light_at(image, slopes[inside], sensor)
    bright = value[inside] > np.quantile(source.value[np.isfinite(source.sd)], 0.05)
    assert np.corrcoef(seen[bright], value[inside][bright])[0, 1] > 0.99
    # The darkest 2 % become 0.
    dark = value[inside] < np.quantile(source.value[np.isfinite(source.sd)], 0.01)
    assert dark.any() and seen[dark].max() < 0.02 * seen.max()
    mirrored = _light_at(image[:, ::-1], slopes[inside], sensor)
    assert abs(np.corrcoef(mirrored, value[inside])[0, 1]) < 0.1
    top = (source.value[np.isfinite(source.sd)]).max()
    assert image.max() == 65535  # The maximum excludes the uncovered edge.
    assert top < 10


def test_the_control_is_mirrored(sensor: Sensor, tmp_path: Path) -> None:
    drawn = pattern_sensor.with_pattern(sensor, _recovered(_lattice(49.0)), tmp_path)
    control = pattern_sensor.with_mirrored_pattern(drawn, tmp_path)
    original, mirrored = (each.projector.emitters[0].pattern for each in (drawn, control))
    np.testing.assert_array_equal(_read(original)[:, ::-1], _read(mirrored))
    assert original != mirrored
    assert control.projector.position_m == drawn.projector.position_m


def test_the_right_images_alignment_is_added(sensor: Sensor) -> None:
    """The shift adds to the sensor's alignment; the roll of the imager has the opposite sign."""
    recovered = _recovered(_lattice(49.0))
    once = pattern_sensor.with_alignment(sensor, recovered.model)
    twice = pattern_sensor.with_alignment(once, recovered.model)
    for aligned, times in ((once, 1), (twice, 2)):
        rest = aligned.right.alignment
        assert rest.offset_y_px == pytest.approx(times * 0.4)
        assert rest.offset_x_px == pytest.approx(times * 0.3)
        assert rest.roll_deg == pytest.approx(-times * np.degrees(0.8 / sensor.fx_px))
        expected = sensor.focal_baseline_px_m - times * 0.09
        assert aligned.focal_baseline_px_m == pytest.approx(expected)
    assert once.left == sensor.left
