"""A recovered pattern's dots as a list."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from starling.calibration.pattern import dots
from starling.calibration.pattern.cosine_image import Grid
from starling.calibration.pattern.emitter_model import Emission, Model
from starling.calibration.pattern.image_recovery import imager_blur_px
from starling.calibration.pattern.lattice import Lattice
from starling.calibration.pattern.pattern_fit import Fitted
from starling.calibration.pattern.recovery import Recovered
from starling.calibration.pattern.unprojected import PatternImage
from starling.sim.render import emission
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

GRID = Grid(half_a=0.4, half_b=0.25, step=1.25e-3)


def _image(places: np.ndarray, heights: np.ndarray, sigma: float) -> PatternImage:
    """Gaussian dots at cosines (n, 2); its left edge was looked at by nobody."""
    a, b = GRID.cosines()
    value = np.zeros(GRID.shape)
    for (x, y), height in zip(places, heights, strict=True):
        across = np.exp(-((a - x) ** 2) / (2 * sigma**2))
        down = np.exp(-((b - y) ** 2) / (2 * sigma**2))
        value += height * down[:, None] * across[None, :]
    sd = np.full(GRID.shape, 0.05, np.float32)
    sd[:, :20] = np.inf
    return PatternImage(grid=GRID, value=value.astype(np.float32), sd=sd, views=sd)


def _recovered(*sources: Lattice | PatternImage) -> Recovered:
    model = Model(
        emitters=tuple(Emission(position_m=np.zeros(3), source=one) for one in sources),
        rotation_deg=(0.0, 0.0, 0.0),
        scales={"a": 1.0},
    )
    count = len(model.names)
    fitted = Fitted(model=model, covariance=np.eye(count), cost=(1.0,), shares=np.ones(1))
    return Recovered(fitted=fitted, image=_image(np.zeros((1, 2)), np.ones(1), 2e-3))


def _lattice(sigma: float) -> Lattice:
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    return Lattice(frequencies=turn / 0.02, phase=np.array([0.2, -0.1]), sigma=sigma)


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return presets.load("d415")


def test_a_lattice_s_dots_fill_the_field(sensor: Sensor) -> None:
    """Every one a dot of the lattice, none outside; as many as the field's solid angle holds."""
    source = _lattice(3e-3)
    (found,) = dots.of(_recovered(source), sensor)
    half_x, half_y = emission.half_tangents(sensor.projector)
    assert (np.abs(found.slopes) < [half_x, half_y]).all()
    far = np.sqrt(1 + (found.slopes**2).sum(axis=1))
    steps = found.slopes / far[:, None] @ source.frequencies.T - source.phase
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    x, y = np.meshgrid(np.linspace(-half_x, half_x, 801), np.linspace(-half_y, half_y, 501))
    cell = (2 * half_x / 800) * (2 * half_y / 500)
    # da db = dx dy / (1 + x^2 + y^2)^2.
    area = float(((1 + x**2 + y**2) ** -2.0).sum() * cell)
    assert len(found.slopes) == pytest.approx(area / 0.02**2, rel=0.03)
    assert (found.power == 1).all() and np.isnan(found.power_sd).all()


def test_a_lattice_s_width_is_less_the_imager_s_blur(sensor: Sensor) -> None:
    blur = imager_blur_px(sensor) / sensor.fx_px
    (found,) = dots.of(_recovered(_lattice(float(np.hypot(2e-3, blur)))), sensor)
    assert found.sigma_mrad == pytest.approx(2.0)
    (sharp,) = dots.of(_recovered(_lattice(0.5 * blur)), sensor)
    assert sharp.sigma_mrad == 0


def test_an_image_s_dots_are_its_tops(sensor: Sensor) -> None:
    """Places to a twentieth of a pixel, powers to 3 %, width to 5 %."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-0.3, 0.31, 0.05), np.arange(-0.2, 0.21, 0.05))
    places = np.stack([x.ravel(), y.ravel()], axis=1) + rng.uniform(-0.01, 0.01, (x.size, 2))
    heights = rng.uniform(1, 3, len(places))
    (found,) = dots.of(_recovered(_image(places, heights, 2.5e-3)), sensor)
    assert len(found.slopes) == len(places)
    cosines = found.slopes / np.sqrt(1 + (found.slopes**2).sum(axis=1))[:, None]
    nearest = [int(np.argmin(((places - one) ** 2).sum(axis=1))) for one in cosines]
    assert np.abs(cosines - places[nearest]).max() < 0.05 * GRID.step
    np.testing.assert_allclose(found.power, heights[nearest] / heights.mean(), rtol=0.05)
    assert found.power.mean() == pytest.approx(1, abs=1e-6)
    assert found.sigma_mrad == pytest.approx(2.5, rel=0.05)


def test_what_is_no_higher_than_its_uncertainty_is_no_dot(sensor: Sensor) -> None:
    """A top of two deviations, and one where nobody looked."""
    places = np.array([[0.0, 0.0], [0.1, 0.0], [-0.39, 0.0]])
    image = _image(places, np.array([1.0, 0.1, 1.0]), 2.5e-3)
    (found,) = dots.of(_recovered(image), sensor)
    np.testing.assert_allclose(found.slopes, [[0, 0]], atol=1e-6)


def test_no_dot_at_all(sensor: Sensor) -> None:
    (found,) = dots.of(_recovered(_image(np.empty((0, 2)), np.empty(0), 2e-3)), sensor)
    assert len(found.slopes) == 0 and np.isnan(found.sigma_mrad)


def test_the_table_lists_every_emitter_s_dots(sensor: Sensor) -> None:
    recovered = _recovered(_lattice(3e-3), _lattice(4e-3))
    rows = list(csv.DictReader(io.StringIO(dots.table(recovered, sensor))))
    first, second = dots.of(recovered, sensor)
    assert len(rows) == len(first.slopes) + len(second.slopes)
    assert [row["emitter"] for row in rows].count("1") == len(second.slopes)
    assert float(rows[0]["x_tangent"]) == pytest.approx(first.slopes[0, 0], rel=1e-5)
    assert float(rows[-1]["sigma_mrad"]) == pytest.approx(second.sigma_mrad, rel=1e-5)


def test_an_imager_widens_dots_by_lens_averaging_and_its_pixels(sensor: Sensor) -> None:
    """A pixel is even from edge to edge: a twelfth of its square."""
    edits = [("imager.lens.blur_px", 0.5), ("imager.smoothing_px", 0.6)]
    expected = np.sqrt(0.5**2 + 0.6**2 + 1 / 12)
    assert imager_blur_px(with_values(sensor, edits)) == pytest.approx(expected)
