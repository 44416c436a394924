"""The imaging chain: neutral strengths are the identity, and every effect changes the image."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from starling.diagnosis.validation.camera.catalogue import ROWS, Strengths
from starling.diagnosis.validation.camera.chain import ExposedPair, expected_electrons, expose
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.diagnosis.validation.camera.projector import Dots

Take = Callable[..., ExposedPair]
IMAGE_EFFECTS = [row.name for row in ROWS.values() if row.kind in ("image", "outside")]


def _same(pair_a: ExposedPair, pair_b: ExposedPair) -> bool:
    return np.array_equal(pair_a.left, pair_b.left) and np.array_equal(pair_a.right, pair_b.right)


@pytest.mark.parametrize("name", list(ROWS))
def test_neutral_is_the_identity_bit_for_bit(take: Take, camera: Nominal, name: str) -> None:
    assert _same(take(**{name: ROWS[name].neutral_of(camera)}), take())


@pytest.mark.parametrize("name", IMAGE_EFFECTS)
def test_every_effect_changes_the_image(take: Take, camera: Nominal, name: str) -> None:
    row = ROWS[name]
    reaches = {sign: row.reach(camera, sign) for sign in row.signs}
    values = [row.value(camera, far, sign) for sign, far in reaches.items() if far > 0]
    for value in [12.0] if row.scale == "choice" else values:
        fixed = {"exposure": 0.03} if name == "blooming" else {}  # Blooming needs full pixels.
        assert not _same(take(**{name: value}, **fixed), take(**fixed))


def test_images_are_reproducible_and_differ_between_streams(take: Take) -> None:
    assert _same(take(seed=3), take(seed=3))
    assert not _same(take(seed=3), take(seed=4))
    assert not _same(take(frame=0), take(frame=1))
    assert not _same(take(scene="a"), take(scene="b"))


@pytest.mark.parametrize("name", ["seed", "frame", "scene"])
def test_noise_of_different_streams_is_independent(name: str) -> None:
    draws = Draws(seed=1, scene="a", frame=0)
    changed = dataclasses.replace(draws, **{name: "b" if name == "scene" else 7})
    a = draws.frame_rng("left/shot").standard_normal(20000)
    b = changed.frame_rng("left/shot").standard_normal(20000)
    c = draws.frame_rng("right/shot").standard_normal(20000)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.03
    assert abs(np.corrcoef(a, c)[0, 1]) < 0.03


def test_streams_depend_on_device_scene_and_frame() -> None:
    """Device streams ignore scene and frame. Scene streams ignore the frame."""
    first, second = Draws(seed=1, scene="a", frame=0), Draws(seed=1, scene="b", frame=3)
    later = Draws(seed=1, scene="a", frame=3)
    assert first.device_rng("x").random() == second.device_rng("x").random()
    assert first.scene_rng("x").random() == later.scene_rng("x").random()
    assert first.scene_rng("x").random() != second.scene_rng("x").random()
    assert first.frame_rng("x").random() != later.frame_rng("x").random()


def test_an_added_effect_does_not_change_the_noise_of_other_effects(
    light: SceneLight, camera: Nominal, projector_dots: Dots, take: Take
) -> None:
    """Rationale: hot pixels must not change the noise of other pixels."""
    with_hot = take(hot_pixels=0.01)
    plain = take()
    changed = with_hot.left != plain.left
    assert 0 < changed.mean() < 0.03


def test_nominal_chain_is_light_times_conversion(
    light: SceneLight, camera: Nominal, projector_dots: Dots
) -> None:
    """Without noise, codes are the black level plus the blurred light, rounded."""
    quiet = dataclasses.replace(camera, shot_noise=0.0, read_noise_e=0.0)
    strengths = Strengths(nominal=quiet, values={})
    draws = Draws(seed=0)
    pair = expose(light, strengths, projector_dots, draws)
    for side, image in (("left", pair.left), ("right", pair.right)):
        expected = 4.0 + 0.0255 * expected_electrons(light, strengths, projector_dots, draws, side)
        np.testing.assert_array_equal(image, np.clip(np.rint(expected), 0, 255))
    total = light.left.laser_e + 0.5 * light.left.ambient_e
    electrons = expected_electrons(light, strengths, projector_dots, draws, "left")
    assert electrons.mean() == pytest.approx(total.mean(), rel=1e-3)
