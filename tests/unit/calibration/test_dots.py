"""The list of a recovered pattern's dots."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from starling.calibration.pattern import dots
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emitter_model import EmitterModel, PatternEmitter
from starling.calibration.pattern.image_recovery import imager_blur_px
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import PatternFit
from starling.calibration.pattern.recovery import RecoveredPattern
from starling.calibration.pattern.unprojected import PatternImage
from starling.sim.render import emission
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

GRID = Grid(half_a=0.4, half_b=0.25, step=1.25e-3)


def _image(places: np.ndarray, heights: np.ndarray, sigma: float) -> PatternImage:
    """Return an image of Gaussian dots at cosines (n, 2), without coverage at its left edge."""
    a, b = GRID.cosines()
    value = np.zeros(GRID.shape)
    for (x, y), height in zip(places, heights, strict=True):
        across = np.exp(-((a - x) ** 2) / (2 * sigma**2))
        down = np.exp(-((b - y) ** 2) / (2 * sigma**2))
        value += height * down[:, None] * across[None, :]
    sd = np.full(GRID.shape, 0.05, np.float32)
    sd[:, :20] = np.inf
    return PatternImage(grid=GRID, value=value.astype(np.float32), sd=sd, views=sd)


def _recovered(*sources: Lattice | PatternImage) -> RecoveredPattern:
    model = EmitterModel(
        emitters=tuple(PatternEmitter(position_m=np.zeros(3), source=source) for source in sources),
        rotation_deg=(0.0, 0.0, 0.0),
        scales={"a": 1.0},
    )
    count = len(model.names)
    fitted = PatternFit(model=model, covariance=np.eye(count), cost=(1.0,), shares=np.ones(1))
    return RecoveredPattern(fitted=fitted, image=_image(np.zeros((1, 2)), np.ones(1), 2e-3))


def _lattice(sigma: float) -> Lattice:
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    return Lattice(frequencies=turn / 0.02, phase=np.array([0.2, -0.1]), sigma=sigma)


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return presets.load("d415")


def test_a_lattice_s_dots_fill_the_field(sensor: Sensor) -> None:
    """All dots lie on the lattice and in the field; their number matches the solid angle."""
    source = _lattice(3e-3)
    (dot_list,) = dots.list_dots(_recovered(source), sensor)
    half_x, half_y = emission.half_tangents(sensor.projector)
    assert (np.abs(dot_list.slopes) < [half_x, half_y]).all()
    far = np.sqrt(1 + (dot_list.slopes**2).sum(axis=1))
    steps = dot_list.slopes / far[:, None] @ source.frequencies.T - source.phase
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    x, y = np.meshgrid(np.linspace(-half_x, half_x, 801), np.linspace(-half_y, half_y, 501))
    cell = (2 * half_x / 800) * (2 * half_y / 500)
    # da db = dx dy / (1 + x^2 + y^2)^2.
    area = float(((1 + x**2 + y**2) ** -2.0).sum() * cell)
    assert len(dot_list.slopes) == pytest.approx(area / 0.02**2, rel=0.03)
    assert (dot_list.power == 1).all() and np.isnan(dot_list.power_sd).all()


def test_the_imagers_blur_is_removed_from_a_lattices_width(sensor: Sensor) -> None:
    blur = imager_blur_px(sensor) / sensor.fx_px
    (dot_list,) = dots.list_dots(_recovered(_lattice(float(np.hypot(2e-3, blur)))), sensor)
    assert dot_list.sigma_mrad == pytest.approx(2.0)
    (sharp,) = dots.list_dots(_recovered(_lattice(0.5 * blur)), sensor)
    assert sharp.sigma_mrad == 0


def test_the_dots_of_an_image_are_its_maxima(sensor: Sensor) -> None:
    """Positions are within 0.05 px, powers and width within 5 %."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-0.3, 0.31, 0.05), np.arange(-0.2, 0.21, 0.05))
    places = np.stack([x.ravel(), y.ravel()], axis=1) + rng.uniform(-0.01, 0.01, (x.size, 2))
    heights = rng.uniform(1, 3, len(places))
    (dot_list,) = dots.list_dots(_recovered(_image(places, heights, 2.5e-3)), sensor)
    assert len(dot_list.slopes) == len(places)
    cosines = dot_list.slopes / np.sqrt(1 + (dot_list.slopes**2).sum(axis=1))[:, None]
    nearest = [int(np.argmin(((places - cosine) ** 2).sum(axis=1))) for cosine in cosines]
    assert np.abs(cosines - places[nearest]).max() < 0.05 * GRID.step
    np.testing.assert_allclose(dot_list.power, heights[nearest] / heights.mean(), rtol=0.05)
    assert dot_list.power.mean() == pytest.approx(1, abs=1e-6)
    assert dot_list.sigma_mrad == pytest.approx(2.5, rel=0.05)


def test_maxima_below_their_uncertainty_are_not_dots(sensor: Sensor) -> None:
    """A maximum of two standard errors and one without coverage are not dots."""
    places = np.array([[0.0, 0.0], [0.1, 0.0], [-0.39, 0.0]])
    image = _image(places, np.array([1.0, 0.1, 1.0]), 2.5e-3)
    (dot_list,) = dots.list_dots(_recovered(image), sensor)
    np.testing.assert_allclose(dot_list.slopes, [[0, 0]], atol=1e-6)


def test_an_image_without_dots(sensor: Sensor) -> None:
    (dot_list,) = dots.list_dots(_recovered(_image(np.empty((0, 2)), np.empty(0), 2e-3)), sensor)
    assert len(dot_list.slopes) == 0 and np.isnan(dot_list.sigma_mrad)


def test_the_table_lists_the_dots_of_each_emitter(sensor: Sensor) -> None:
    recovered = _recovered(_lattice(3e-3), _lattice(4e-3))
    rows = list(csv.DictReader(io.StringIO(dots.table(recovered, sensor))))
    first, second = dots.list_dots(recovered, sensor)
    assert len(rows) == len(first.slopes) + len(second.slopes)
    assert [row["emitter"] for row in rows].count("1") == len(second.slopes)
    assert float(rows[0]["x_tangent"]) == pytest.approx(first.slopes[0, 0], rel=1e-5)
    assert float(rows[-1]["sigma_mrad"]) == pytest.approx(second.sigma_mrad, rel=1e-5)


def test_imager_blur_sums_lens_averaging_and_pixel(sensor: Sensor) -> None:
    """A square pixel adds a variance of 1/12 px^2."""
    edits = [("imager.lens.blur_px", 0.5), ("imager.smoothing_px", 0.6)]
    expected = np.sqrt(0.5**2 + 0.6**2 + 1 / 12)
    assert imager_blur_px(with_values(sensor, edits)) == pytest.approx(expected)
