"""A recovered pattern as a sensor: images on disk, emitters in their places."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

from starling.calibration.pattern import pattern_sensor
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emission import Alignment
from starling.calibration.pattern.emitter_model import Emission, Model
from starling.calibration.pattern.image_recovery import imager_blur_px
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import Fitted
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.pattern.unprojected import PatternImage
from starling.patterns.field import Field
from starling.sim.captures import png
from starling.sim.geometry import frames
from starling.sim.render import emission
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

GRID = Grid(half_a=0.66, half_b=0.46, step=2e-3)


def _image() -> PatternImage:
    """Smooth and without any symmetry; an edge that nobody saw, whose values mean nothing."""
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


def _recovered(*sources: Lattice | PatternImage) -> Recovered:
    places = np.array([[0.026, 0.001, -0.001], [0.0305, 0.0, 0.001]])
    model = Model(
        emitters=tuple(
            Emission(position_m=place, source=one)
            for place, one in zip(places, sources, strict=False)
        ),
        rotation_deg=(2.0, -3.0, 1.0),
        scales={"a": 1.0},
        alignment=Alignment(offset_y=0.4, roll=0.8, offset_x=0.3, focal_baseline=0.09),
    )
    fitted = Fitted(
        model=model,
        covariance=np.eye(len(model.names)),
        cost=(1.0,),
        shares=np.array([0.6, 0.4])[: len(sources)],
    )
    return Recovered(fitted=fitted, image=_image())


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return presets.load("d415")


def _read(path: str) -> np.ndarray:
    return np.asarray(png.read(Path(path), "pattern"), np.float64)


def _light_at(image: np.ndarray, slopes: np.ndarray, sensor: Sensor) -> np.ndarray:
    """A written pattern at tangents (n, 2), by the field's own convention."""
    field = Field(sensor.projector.fov_x_deg, sensor.projector.fov_y_deg)
    x, y = field.pixels(slopes[:, 0], slopes[:, 1], (image.shape[0], image.shape[1]))
    return ndimage.map_coordinates(image, [y, x], order=1, mode="nearest")


def _inside(cosines: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Tangents of those directions that are well inside the projector's field."""
    slopes = cosines / np.sqrt(1 - (cosines**2).sum(axis=1))[:, None]
    return (np.abs(slopes) < 0.95 * np.array(emission.half_tangents(sensor.projector))).all(axis=1)


def test_emitters_stand_where_they_were_found(sensor: Sensor, tmp_path: Path) -> None:
    recovered = _recovered(_lattice(49.0), _lattice(60.0))
    light = pattern_sensor.with_pattern(sensor, recovered, tmp_path).projector
    assert light.rotation_deg == recovered.model.rotation_deg
    for emitter, one in zip(light.emitters, recovered.model.emitters, strict=True):
        place = np.array(light.position_m) + frames.rotation(light.rotation_deg) @ np.array(
            emitter.offset_m
        )
        np.testing.assert_allclose(place, one.position_m, atol=1e-12)
    assert [emitter.power_share for emitter in light.emitters] == [0.6, 0.4]
    assert [Path(emitter.pattern).name for emitter in light.emitters] == [
        "emitter-0.png",
        "emitter-1.png",
    ]
    assert all(Path(emitter.pattern).is_file() for emitter in light.emitters)


def test_a_lattice_s_dots_are_drawn_where_it_has_them(sensor: Sensor, tmp_path: Path) -> None:
    """Bright at every dot, dark halfway to the next; mirrored, at few of them."""
    source = _lattice(49.0)
    drawn = pattern_sensor.with_pattern(sensor, _recovered(source), tmp_path)
    image = _read(drawn.projector.emitters[0].pattern)
    cosines = source.dots(0.6, 0.4)
    cosines = cosines[_inside(cosines, sensor)]
    between = cosines + source.pitch @ np.array([0.5, 0.5])
    far = np.sqrt(1 - (cosines**2).sum(axis=1))[:, None]
    bright = _light_at(image, cosines / far, sensor)
    # Dots of one power are dimmer off the axis, as the plane meets them larger: 1 / cos^4.
    expected = bright.max() * far[:, 0] ** 4
    np.testing.assert_allclose(bright / expected, 1, atol=0.15)
    dark = _light_at(image, between / np.sqrt(1 - (between**2).sum(axis=1))[:, None], sensor)
    assert dark.max() < 0.05 * bright.max()
    turned = _light_at(image[:, ::-1], cosines / far, sensor)
    assert np.mean(turned > 0.5 * expected) < 0.5


def test_drawn_dots_lack_the_imager_s_blur(sensor: Sensor, tmp_path: Path) -> None:
    """Seen width squared less blur squared, read off a dot on the axis; 1 mrad at least."""
    blur = imager_blur_px(sensor) / sensor.fx_px
    for own, drawn_mrad in ((2e-3, 2.0), (0.2e-3, 1.0)):
        source = dataclasses.replace(
            _lattice(0.0, sigma=float(np.hypot(own, blur))), phase=np.zeros(2)
        )
        drawn = pattern_sensor.with_pattern(sensor, _recovered(source), tmp_path)
        image = _read(drawn.projector.emitters[0].pattern)
        beside = np.array([[0.0, 0.0], [drawn_mrad * 1e-3, 0.0]])
        middle, side = _light_at(image, beside, sensor)
        assert side / middle == pytest.approx(np.exp(-0.5), abs=0.08)


def test_an_image_is_resampled_into_the_field(sensor: Sensor, tmp_path: Path) -> None:
    """Value for value at its directions, up to gain and offset; what nobody saw adds nothing."""
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
    # The darkest fiftieth is no light, and neither is what is darker than that.
    dark = value[inside] < np.quantile(source.value[np.isfinite(source.sd)], 0.01)
    assert dark.any() and seen[dark].max() < 0.02 * seen.max()
    mirrored = _light_at(image[:, ::-1], slopes[inside], sensor)
    assert abs(np.corrcoef(mirrored, value[inside])[0, 1]) < 0.1
    top = (source.value[np.isfinite(source.sd)]).max()
    assert image.max() == 65535  # Of what was seen: the blind edge's 50 is not the top.
    assert top < 10


def test_the_control_is_turned_over(sensor: Sensor, tmp_path: Path) -> None:
    drawn = pattern_sensor.with_pattern(sensor, _recovered(_lattice(49.0)), tmp_path)
    control = pattern_sensor.mirrored(drawn, tmp_path)
    one, other = (each.projector.emitters[0].pattern for each in (drawn, control))
    np.testing.assert_array_equal(_read(one)[:, ::-1], _read(other))
    assert one != other
    assert control.projector.position_m == drawn.projector.position_m


def test_the_right_image_s_rest_is_added(sensor: Sensor) -> None:
    """To what the sensor has already; less f b is less baseline, and the image's turn is the
    imager's the other way."""
    recovered = _recovered(_lattice(49.0))
    once = pattern_sensor.aligned(sensor, recovered.model)
    twice = pattern_sensor.aligned(once, recovered.model)
    for found, times in ((once, 1), (twice, 2)):
        rest = found.right.alignment
        assert rest.offset_y_px == pytest.approx(times * 0.4)
        assert rest.offset_x_px == pytest.approx(times * 0.3)
        assert rest.roll_deg == pytest.approx(-times * np.degrees(0.8 / sensor.fx_px))
        expected = sensor.focal_baseline_px_m - times * 0.09
        assert found.focal_baseline_px_m == pytest.approx(expected)
    assert once.left == sensor.left
