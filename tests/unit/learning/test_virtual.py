"""The virtual camera: drawn conditions and captures."""

from __future__ import annotations

import numpy as np
import pytest

from starling.learning.data.virtual import captures
from starling.sim.scene.builtin import scenes

pytestmark = pytest.mark.slow

SEEDS = range(60)


def test_the_seed_determines_the_conditions() -> None:
    believed = scenes.clutter(3)
    sensor, scene = captures.conditions(believed, 4)
    assert captures.conditions(believed, 4)[0] == sensor
    assert captures.conditions(believed, 5)[0] != sensor
    again = captures.conditions(believed, 4)[1]
    assert [b.material for b in again.bodies] == [b.material for b in scene.bodies]
    assert scene.ambient.irradiance_w_m2 > 0 and scene.interreflection == 1


def test_variations_stay_within_their_range() -> None:
    believed = scenes.clutter(0)
    drawn = [captures.conditions(believed, seed) for seed in SEEDS]
    levels = [sensor.left.auto_exposure_level for sensor, _ in drawn]
    assert 0.14 <= min(levels) < 0.18 and 0.23 < max(levels) <= 0.27
    light = np.array([scene.ambient.irradiance_w_m2 for _, scene in drawn])
    assert 0.02 <= light.min() < 0.03 and 0.06 < light.max() <= 0.092


def test_temperature_changes_its_group() -> None:
    drawn = [captures.conditions(scenes.wall(), seed)[0] for seed in SEEDS]
    scales = [sensor.projector.pattern_scale for sensor in drawn]
    waves = [sensor.projector.wavelength_nm for sensor in drawn]
    assert np.corrcoef(scales, waves)[0, 1] == pytest.approx(1.0, abs=1e-3)


def test_only_matt_objects_are_dyed() -> None:
    believed = scenes.clutter(0)
    for seed in SEEDS:
        true = captures.conditions(believed, seed)[1]
        for report, present in zip(believed.bodies, true.bodies, strict=True):
            ratio = present.material.reflectance / report.material.reflectance
            if report.material.kind not in ("diffuse", "glossy"):
                assert ratio == 1
            elif report.name in ("wall", "table", "floor", "back"):
                assert 0.45 <= ratio <= 1.6 or present.material.reflectance in (0.02, 0.9)
            assert 0.02 <= present.material.reflectance <= 0.9 or ratio == 1


def test_it_has_holes_where_a_clean_camera_has_none() -> None:
    shot = captures.capture(scenes.clutter(3), 2, samples=4)
    assert 0.02 < np.mean(~shot.depth.valid) < 0.15
    assert 0.1 < shot.ir_left.mean() / 255 < 0.35
