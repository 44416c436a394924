"""The whole camera: neutral is the identity, every effect acts, draws are of what they are of."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from starling.diagnosis.validation.camera.catalogue import ROWS, Strengths
from starling.diagnosis.validation.camera.chain import Pair, at_pixels, expose
from starling.diagnosis.validation.camera.dots import Dots
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import Light
from starling.diagnosis.validation.camera.nominal import Nominal

Take = Callable[..., Pair]
SEEN = [row.name for row in ROWS.values() if row.kind in ("image", "outside")]


def _same(one: Pair, other: Pair) -> bool:
    return np.array_equal(one.left, other.left) and np.array_equal(one.right, other.right)


@pytest.mark.parametrize("name", list(ROWS))
def test_neutral_is_the_identity_bit_for_bit(take: Take, camera: Nominal, name: str) -> None:
    assert _same(take(**{name: ROWS[name].neutral_of(camera)}), take())


@pytest.mark.parametrize("name", SEEN)
def test_every_effect_acts(take: Take, camera: Nominal, name: str) -> None:
    row = ROWS[name]
    reaches = {sign: row.reach(camera, sign) for sign in row.signs}
    values = [row.value(camera, far, sign) for sign, far in reaches.items() if far > 0]
    for value in [12.0] if row.scale == "choice" else values:
        with_others = {"exposure": 0.03} if name == "blooming" else {}  # It needs full pixels.
        assert not _same(take(**{name: value}, **with_others), take(**with_others))


def test_draws_repeat_and_differ(take: Take) -> None:
    assert _same(take(seed=3), take(seed=3))
    assert not _same(take(seed=3), take(seed=4))
    assert not _same(take(frame=0), take(frame=1))
    assert not _same(take(scene="a"), take(scene="b"))


@pytest.mark.parametrize("name", ["seed", "frame", "scene"])
def test_noise_of_other_draws_is_independent(name: str) -> None:
    one = Draws(seed=1, scene="a", frame=0)
    other = dataclasses.replace(one, **{name: "b" if name == "scene" else 7})
    a = one.of_frame("left/shot").standard_normal(20000)
    b = other.of_frame("left/shot").standard_normal(20000)
    c = one.of_frame("right/shot").standard_normal(20000)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.03
    assert abs(np.corrcoef(a, c)[0, 1]) < 0.03


def test_birth_scene_and_time_are_apart() -> None:
    """What a device has by birth knows neither scene nor frame; what a scene has knows no frame."""
    one, other = Draws(seed=1, scene="a", frame=0), Draws(seed=1, scene="b", frame=3)
    later = Draws(seed=1, scene="a", frame=3)
    assert one.of_device("x").random() == other.of_device("x").random()
    assert one.of_scene("x").random() == later.of_scene("x").random()
    assert one.of_scene("x").random() != other.of_scene("x").random()
    assert one.of_frame("x").random() != later.of_frame("x").random()


def test_adding_an_effect_redraws_no_other(
    light: Light, camera: Nominal, found: Dots, take: Take
) -> None:
    """Rationale: a hot pixel more must not change the noise of the pixels beside it."""
    with_hot = take(hot_pixels=0.01)
    plain = take()
    changed = with_hot.left != plain.left
    assert 0 < changed.mean() < 0.03


def test_nominal_chain_is_light_times_conversion(
    light: Light, camera: Nominal, found: Dots
) -> None:
    """Without noise, codes are the black level and the blurred light, rounded."""
    quiet = dataclasses.replace(camera, shot_noise=0.0, read_noise_e=0.0)
    strengths = Strengths(nominal=quiet, values={})
    draws = Draws(seed=0)
    pair = expose(light, strengths, found, draws)
    for side, image in (("left", pair.left), ("right", pair.right)):
        expected = 4.0 + 0.0255 * at_pixels(light, strengths, found, draws, side)
        np.testing.assert_array_equal(image, np.clip(np.rint(expected), 0, 255))
    total = light.left.laser_e + 0.5 * light.left.ambient_e
    seen = at_pixels(light, strengths, found, draws, "left")
    assert seen.mean() == pytest.approx(total.mean(), rel=1e-3)
