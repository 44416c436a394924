"""Laws of several emitters in one projector, on a table and on walls.

Rationale: light is additive. A projector of several emitters is therefore the sum of projectors of
one emitter each, at its position and with its share of the power. In the left image, the dots of an
emitter at x are f x / z to the right of those of an emitter at 0.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from starling.patterns import InputError, Pattern
from starling.patterns.field import Field
from starling.sim.effects import setting
from starling.sim.geometry import frames
from starling.sim.render import backend, emission, indirect, scalar
from starling.sim.render import direct as render
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.projector import Emitter
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo import structured_light

pytestmark = pytest.mark.slow

FOCAL_PX = 400.0
LEFT, RIGHT = (0.026, 0.0, 0.0), (0.0305, 0.001, -0.002)


def camera(**light: Any) -> Sensor:
    """A small D415, by default with one emitter at the left imager."""
    preset = presets.load("d415")
    part = dataclasses.replace(preset.projector, position_m=(0.0, 0.0, 0.0), emitters=())
    return dataclasses.replace(
        preset,
        width=160,
        height=120,
        fx_px=100.0,
        fy_px=100.0,
        cx_px=79.5,
        cy_px=59.5,
        projector=dataclasses.replace(part, **light),
    )


def rendered(sensor: Sensor, scene: Scene | None = None) -> Layers:
    return render.layers(MitsubaScene(scene or scenes.tabletop()), sensor)


def assert_alike(first: Layers, second: Layers, name: str = "projector_direct") -> None:
    """Assert equality up to the rounding of positions, which moves dots by some 1e-5 px."""
    for a, b in ((first.left, second.left), (first.right, second.right)):
        assert a is not None and b is not None
        one, other = getattr(a, name), getattr(b, name)
        assert one.any()
        close = np.isclose(one, other, rtol=2e-3, atol=1e-4 * other.max())
        assert close.mean() > 0.999  # Rounding may move a shadow's border across a pixel.
    assert (first.truth.lit == second.truth.lit).mean() > 0.999


@pytest.mark.parametrize(
    "light",
    [{}, {"pattern": "d435"}, {"defocus_mrad_m": 0.5}, {"pattern_scale": 1.003}],
    ids=["d415", "d435", "defocus", "scale"],
)
def test_two_equal_emitters_at_one_position_equal_one(light: dict[str, Any]) -> None:
    """Emitters that share the power equal a single one, bit for bit.

    At another pattern scale on a GPU they agree to rounding, since its compiler fuses products and
    sums differently in each kernel.
    """
    rounds = "pattern_scale" in light and str(backend.mitsuba().variant()).startswith("cuda")
    one = rendered(camera(**light))
    for several in ((Emitter(),), (Emitter(power_share=3.0), Emitter(power_share=3.0))):
        same = rendered(camera(**light, emitters=several))
        if rounds:
            assert_alike(one, same)
            continue
        assert np.array_equal(one.left.projector_direct, same.left.projector_direct)
        assert np.array_equal(one.truth.lit, same.truth.lit)


shifts = st.floats(-0.05, 0.05)
turns = st.floats(-20.0, 20.0)


@settings(max_examples=5)
@given(st.tuples(shifts, shifts, shifts), st.tuples(turns, turns, turns))
def test_an_emitter_is_a_projector_of_its_own(
    offset_m: tuple[float, float, float], rotation_deg: tuple[float, float, float]
) -> None:
    """An emitter's pose is relative to the projector's, whose rotation also rotates its offset."""
    part = camera(position_m=(0.02, 0.0, 0.0), rotation_deg=(3.0, -5.0, 30.0)).projector
    emitter = Emitter(offset_m=offset_m, rotation_deg=rotation_deg)
    pose = frames.pose(part.position_m, part.rotation_deg) @ frames.pose(offset_m, rotation_deg)
    on_its_own = dataclasses.replace(
        part, position_m=tuple(pose[:3, 3]), rotation_deg=rotation_vector_deg(pose[:3, :3])
    )
    on_projector = dataclasses.replace(part, emitters=(emitter,))
    first, second = (
        rendered(dataclasses.replace(camera(), projector=each))
        for each in (on_projector, on_its_own)
    )
    assert_alike(first, second)


def rotation_vector_deg(matrix: np.ndarray) -> tuple[float, ...]:
    angle = np.arccos(np.clip((np.trace(matrix) - 1) / 2, -1, 1))
    axis = np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])
    axis = axis - np.array([matrix[1, 2], matrix[2, 0], matrix[0, 1]])
    return tuple(np.rad2deg(angle * axis / (2 * np.sin(angle))))


SHARES = 3.0, 1.0
TWO = tuple(
    Emitter(offset_m=offset, power_share=share)
    for offset, share in zip((LEFT, (-0.08, 0.0, 0.0)), SHARES, strict=True)
)


@pytest.mark.parametrize(
    "effects",
    [{}, {"transparency": 0.3}, {"motion.x": 0.2}, {"model_scale": 1.04}],
    ids=["plain", "glass", "motion", "model scale"],
)
def test_light_of_emitters_adds(effects: dict[str, float]) -> None:
    """Direct and indirect light are sums over emitters by power share; `lit` is their union.

    The test assumes that the light of two lasers is incoherent.
    """
    parts = []
    for emitters in (TWO, TWO[:1], TWO[1:]):
        sensor, scene = setting.apply(camera(emitters=emitters), scenes.tabletop(), effects)
        stage = MitsubaScene(scene)
        direct = render.layers(stage, sensor, exposure_s=0.01)
        if not effects:
            direct = indirect.add(direct, stage, sensor, samples=4, seed=1)
        parts.append(direct)
    whole, first, second = parts
    for name in ("projector_direct", "projector_indirect")[: 1 if effects else 2]:
        expected = 0.75 * getattr(first.left, name) + 0.25 * getattr(second.left, name)
        measured = getattr(whole.left, name)
        tolerance = (
            1e-5 if name == "projector_direct" else 0.02
        )  # The weight of a path decides where it ends.
        assert abs(measured - expected).max() <= tolerance * expected.max()
    assert np.array_equal(whole.truth.lit, first.truth.lit | second.truth.lit)
    assert (first.truth.lit != second.truth.lit).any()


def test_the_path_tracer_without_a_compiler_adds_emitters() -> None:
    """Indirect light of two emitters is the sum of theirs, by position and power share."""
    both = camera(emitters=TWO)
    stage, shares = MitsubaScene(scenes.tabletop()), (0.75, 0.25)

    def bounced(sensor: Sensor, irradiances: list[np.ndarray]) -> np.ndarray:
        pose = stage.scene.world_from_left
        return scalar.radiance(stage, sensor, pose, irradiances, shrink=4, samples=4, seed=1)

    lit = [emission.irradiance_at_unit_distance(both.projector, number) for number in (0, 1)]
    each = [
        share * bounced(one, [emission.irradiance_at_unit_distance(one.projector)])
        for share, one in zip(shares, (camera(position_m=e.offset_m) for e in TWO), strict=True)
    ]
    assert all(image.any() for image in each)
    np.testing.assert_allclose(bounced(both, lit), sum(each), rtol=1e-4, atol=1e-5 * each[0].max())


def test_emitters_shrink_with_the_models_scale() -> None:
    """In a model enlarged by 1.04, an emitter equals a projector at its position."""
    effects = {"model_scale": 1.04}
    on_projector = setting.apply(
        camera(emitters=(Emitter(offset_m=LEFT),)), scenes.tabletop(), effects
    )
    alone = setting.apply(camera(position_m=LEFT), scenes.tabletop(), effects)
    assert_alike(rendered(*on_projector), rendered(*alone))


@pytest.fixture
def one_dot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Sensor]:
    """A camera of 2.5 mrad per pixel, and a projector with one dot at tangent 0.1."""

    def make(*, fov_x_deg: float, fov_y_deg: float, seed: int) -> Pattern:
        dot = np.array([0.1])
        return Pattern.from_dots(
            dot,
            0 * dot,
            0 * dot + 1,
            field=Field(fov_x_deg, fov_y_deg),
            width_px=1920,
            fwhm_mrad=8.0,
            background=0.0,
            name=f"one dot, seed {seed}",
        )

    monkeypatch.setitem(emission.GENERATORS, "one dot", make)
    sensor = camera(pattern="one dot", fov_x_deg=40.0, fov_y_deg=40.0)
    yield dataclasses.replace(sensor, fx_px=FOCAL_PX, fy_px=FOCAL_PX)


def column_px(sensor: Sensor, distance_m: float) -> float:
    image = rendered(sensor, scenes.wall(distance_m)).left.projector_direct.astype(np.float64)
    return float((image.sum(axis=0) * np.arange(image.shape[1])).sum() / image.sum())


@pytest.mark.parametrize("distance_m", [0.5, 1.0, 3.0])
def test_dots_of_an_emitter_are_shifted_by_f_x_over_z(one_dot: Sensor, distance_m: float) -> None:
    """Dots of both emitters are at f x / z to 0.01 px, so the patterns' offset is f dx / z.

    The test does not show where a device's emitters are.
    """
    home = column_px(one_dot, distance_m)
    for x in (-0.026, 0.0305):
        light = dataclasses.replace(one_dot.projector, emitters=(Emitter(offset_m=(x, 0, 0)),))
        measured = column_px(dataclasses.replace(one_dot, projector=light), distance_m)
        assert measured - home == pytest.approx(FOCAL_PX * x / distance_m, abs=0.01)


def test_emitters_have_independent_faults() -> None:
    """The first emitter has the faults of a single emitter; the second has different ones."""
    worn = dataclasses.replace(
        camera().projector, dropped_dots=0.3, emitters=(Emitter(), Emitter())
    )
    first, second = (emission.irradiance_at_unit_distance(worn, number) for number in (0, 1))
    single = emission.irradiance_at_unit_distance(dataclasses.replace(worn, emitters=()))
    assert np.array_equal(2 * first, single)
    assert not np.array_equal(first, second)


def test_emitters_fall_back_on_the_projectors_pattern() -> None:
    part = camera(emitters=(Emitter(), Emitter(pattern="d435", power_share=3.0))).projector
    assert [emitter.pattern for emitter in emission.emitters(part)] == ["d415", "d435"]
    assert [emitter.power_share for emitter in emission.emitters(part)] == [0.25, 0.75]


def test_structured_light_has_one_emitter() -> None:
    kinect = presets.load("kinect-v1")
    light = dataclasses.replace(kinect.projector, emitters=(Emitter(), Emitter()))
    with pytest.raises(InputError, match=r"projector\.emitters must be \[\] with structured light"):
        structured_light.reference_image(dataclasses.replace(kinect, projector=light))


def test_the_scalar_renderer_refuses_another_scale() -> None:
    named = r"^projector\.pattern_scale other than 1 must be absent in scalar_rgb"
    with pytest.raises(backend.BackendError, match=named):
        scalar.layers(MitsubaScene(scenes.wall(1.0)), camera(pattern_scale=1.002), subpixels=1)
