"""Effects in the whole pipeline: neutral is the identity, and each effect acts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.sim import effects, simulate
from starling.sim.commands import atlas
from starling.sim.effects import Effect, Stage, Value, setting
from starling.sim.imaging import imager
from starling.sim.render import direct
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

pytestmark = pytest.mark.slow

SMALL = 0.4
FRAMES = 5  # For temporal effects.


@cache
def noisy() -> tuple[Sensor, Scene]:
    """A D435 preset at two fifths of its resolution."""
    preset = presets.load("d435")
    geometry = {
        name: getattr(preset, name) * SMALL for name in ("fx_px", "fy_px", "cx_px", "cy_px")
    }
    size = {name: round(getattr(preset, name) * SMALL) for name in ("width", "height")}
    matcher = dataclasses.replace(preset.matcher, search_px=64)
    return dataclasses.replace(preset, **geometry, **size, matcher=matcher), scenes.tabletop()


@cache
def ideal() -> tuple[Sensor, Scene]:
    """The same sensor with neutral settings, in ambient light."""
    sensor, scene = setting.ideal(*noisy())
    return sensor, setting.on_scene(scene, {"ambient": 0.1})


@cache
def ideal_layers() -> Layers:
    sensor, scene = ideal()
    return direct.layers(MitsubaScene(scene), sensor)


def test_the_ideal_camera_only_scales_light() -> None:
    """With neutral settings the infrared equals scaled, rounded light, bit for bit.

    The test excludes settings after the infrared (matcher, post-processing).
    """
    sensor, scene = ideal()
    layers = ideal_layers()
    pair = simulate.infrared(layers, scene, sensor, seed=3, frame=2)
    part = sensor.left
    scale = np.float32(
        imager.electrons_per_radiance(part, sensor.projector.wavelength_nm, part.exposure_s)
    )
    power, ambient = (
        np.float32(sensor.projector.power_w),
        np.float32(scene.ambient.irradiance_w_m2),
    )
    for view, seen in ((layers.left, pair.left), (layers.right, pair.right)):
        radiance = view.projector_direct * power + (view.ambient * ambient + view.other)
        electrons = np.minimum(radiance * scale, np.float32(part.full_well_e))
        expected = np.rint(electrons * np.float32(part.dn_per_electron)).astype(np.uint16)
        assert np.array_equal(seen, expected)


def _moved(row: Effect, base: tuple[Sensor, Scene]) -> dict[str, Value]:
    """A value of the effect's first parameter far from neutral."""
    first = row.parameters[0]
    near_value = setting.value(first, *base)
    ends: tuple[Any, ...] = first.choices or (first.low, first.high)
    return {row.name: next(end for end in reversed(ends) if end != near_value)}


NO_NEED = [row for row in effects.table() if not row.rerender and row.stage is not Stage.MATCHER]


@settings(max_examples=25)
@given(st.sets(st.sampled_from(NO_NEED), max_size=6), st.integers(0, 5))
def test_returning_to_neutral_restores_all_bits(rows: set[Effect], seed: int) -> None:
    """Random effects change from neutral and return: the infrared has the same bits."""
    base = ideal()
    away = {name: value for row in rows for name, value in _moved(row, base).items()}
    back = {name: setting.value(setting.parameter_of(name)[1], *base) for name in away}
    sensor, scene = setting.apply(*setting.apply(*base, away), back)
    first = simulate.infrared(ideal_layers(), base[1], base[0], seed=seed)
    again = simulate.infrared(ideal_layers(), scene, sensor, seed=seed)
    assert np.array_equal(first.left, again.left) and np.array_equal(first.right, again.right)


def _reading(sensor: Sensor, scene: Scene) -> list[np.ndarray]:
    frames = FRAMES if sensor.post.temporal_alpha < 1 else 2
    *_, shot = simulate.sequence(scene, sensor, frames=frames)
    depth = np.rint(np.nan_to_num(shot.depth.depth_m / sensor.post.depth_unit_m, nan=-1))
    return [
        *(
            image / part.ceiling_dn
            for image, part in ((shot.ir_left, sensor.left), (shot.ir_right, sensor.right))
        ),
        depth * sensor.post.depth_unit_m,
        np.nan_to_num(shot.registered_m) if shot.registered_m is not None else np.zeros(1),
    ]


@cache
def base(plain: Callable[[], tuple[Sensor, Scene]], row: str) -> tuple[Sensor, Scene]:
    """The sensor and scene that show an effect; "" stands for effects that need no others."""
    return setting.apply(*plain(), atlas.SHOWN_WITH.get(row, {}))


@cache
def base_reading(plain: Callable[[], tuple[Sensor, Scene]], row: str) -> list[np.ndarray]:
    return _reading(*base(plain, row))


@pytest.mark.parametrize("row", effects.table(), ids=lambda row: row.name)
def test_every_row_acts(row: Effect) -> None:
    """A non-neutral effect changes the infrared, the depth or the registered depth."""
    plain = noisy if row.stage in (Stage.MATCHER, Stage.POST) else ideal
    shown = row.name if row.name in atlas.SHOWN_WITH else ""
    sensor, scene = base(plain, shown)

    def acts(value: Value) -> bool:
        changed = _reading(*setting.apply(sensor, scene, {row.name: value}))
        return any(
            before.shape != after.shape or not np.array_equal(before, after)
            for before, after in zip(base_reading(plain, shown), changed, strict=True)
        )

    assert any(acts(end) for end in atlas.far_ends(row, sensor, scene))
