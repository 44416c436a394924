"""The projector's pattern by name, by file, and its refusals."""

import dataclasses

import numpy as np
import pytest

from patterns import InputError
from sim import projector, sensors
from sim.sensor import Projector


@pytest.mark.parametrize("name", sorted(projector.GENERATORS))
def test_every_generator_can_be_projected(name):
    part = Projector(pattern=name, fov_x_deg=60.0, fov_y_deg=40.0)
    image = projector.irradiance_at_unit_distance(part)
    area = 4 * np.tan(np.deg2rad(30)) * np.tan(np.deg2rad(20))
    assert image.mean(dtype=np.float64) * area == pytest.approx(1, rel=1e-3)


def test_every_preset_names_a_pattern():
    for name in sensors.names():
        assert sensors.load(name).projector.pattern in projector.GENERATORS


def test_falloff_takes_light_from_the_edge_only():
    even = Projector()
    dimmed = dataclasses.replace(even, falloff=3.0)
    ratio = projector.irradiance_at_unit_distance(dimmed) / np.maximum(
        projector.irradiance_at_unit_distance(even), 1e-12
    )
    rows, columns = ratio.shape
    assert ratio[rows // 2, columns // 2] == pytest.approx(1.0, abs=1e-4)
    assert ratio.max() <= 1 + 1e-6
    assert ratio[rows // 2, 0] == pytest.approx(np.cos(np.deg2rad(45)) ** 3, rel=0.01)


def test_unknown_patterns():
    with pytest.raises(InputError, match=r"projector\.pattern must be a known name; got 'd436'"):
        projector.irradiance_at_unit_distance(Projector(pattern="d436"))
    with pytest.raises(InputError):
        projector.irradiance_at_unit_distance(Projector(pattern="missing.png"))
