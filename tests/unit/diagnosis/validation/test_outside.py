"""Effects outside the table."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.diagnosis.validation.camera import outside
from starling.diagnosis.validation.camera.catalogue import Strengths
from starling.diagnosis.validation.camera.draws import Draws
from starling.diagnosis.validation.camera.light import ReceivedLight, SceneLight
from starling.diagnosis.validation.camera.nominal import Nominal

DRAWS = Draws(seed=1, scene="a")


def test_ghost_is_mirrored_through_the_centre() -> None:
    light = np.zeros((40, 60))
    light[5, 10] = 100.0
    out = outside.ghost(light, 0.2)
    assert np.unravel_index(np.argmax(out - light), out.shape) == (34, 49)
    assert (out - light).sum() == pytest.approx(20.0, rel=0.01)
    assert outside.ghost(light, 0.0) is light


def test_lamp_bands_follow_rows_and_change_with_frames(light: SceneLight) -> None:
    view = light.left
    flat = dataclasses.replace(view, ambient_e=np.full(view.px.shape, 7.0))
    base = np.full(view.px.shape, 50.0)
    out = outside.lamps(base, flat, 0.4, DRAWS)
    assert out.std(1).max() == pytest.approx(0.0, abs=1e-9)
    assert out.mean() == pytest.approx(70.0, abs=8.0)
    later = outside.lamps(base, flat, 0.4, dataclasses.replace(DRAWS, frame=1))
    assert np.abs(out - later).max() > 5.0


def test_astigmatism_rotates_over_the_field(camera: Nominal) -> None:
    """Expected behaviour: little blur at the centre, and different directions at the edges."""

    def moments(row: int, column: int) -> np.ndarray:
        point = np.zeros(camera.shape)
        point[row, column] = 1.0
        out = outside.astigmatism(point, 2.0, camera)
        y, x = np.mgrid[: camera.height, : camera.width]
        offsets = np.stack([(x - column).ravel(), (y - row).ravel()])
        return np.cov(offsets, aweights=out.ravel())

    assert np.abs(moments(31, 47)).max() < 0.6
    right, below = moments(31, 80), moments(54, 47)
    assert right[0, 1] > 0.4
    assert below[0, 1] < -0.4


def test_fingerprint_is_on_one_lens_only(camera: Nominal) -> None:
    light = np.full(camera.shape, 100.0)
    left, right = (outside.finger_print(light, 0.6, side, DRAWS) for side in ("left", "right"))
    assert (left is light) != (right is light)
    smeared = right if left is light else left
    assert smeared.min() < 75.0
    assert smeared.max() > 99.0


def test_ramp_moves_between_frames() -> None:
    light = np.full((50, 20), 10.0)
    out = outside.ramp(light, 0.5, 0)
    assert out.min() >= 5.0 and out.max() <= 15.0
    assert np.argmax(out[:, 0]) != np.argmax(outside.ramp(light, 0.5, 1)[:, 0])


def test_column_rain_decays_downwards() -> None:
    out = outside.column_rain(np.zeros((60, 400)), 0.1, 1000.0, "left", DRAWS)
    wet = out.any(0)
    assert 0.04 < wet.mean() < 0.18
    assert out.max() <= 1000.0
    column = out[:, np.flatnonzero(wet)[0]]
    begin = np.flatnonzero(column)[0]
    assert (np.diff(column[begin:]) <= 0).all()


def test_a_displaced_body_has_more_disparity(light: SceneLight, camera: Nominal) -> None:
    """Law: the body moves left by the strength in the right image; other pixels do not change."""
    strengths = Strengths(nominal=camera, values={"body_offset": 3.0})
    received = ReceivedLight(laser_e=light.right.laser_e, rest_e=light.right.ambient_e)
    out = outside.displace_body(received, light, strengths, DRAWS)
    box = light.right.body == 2
    rows, columns = np.nonzero(box)
    inner = np.s_[rows.min() + 2 : rows.max() - 2, columns.min() + 2 : columns.max() - 6]
    moved = np.s_[inner[0], inner[1].start - 3 : inner[1].stop - 3]
    np.testing.assert_allclose(out.laser_e[moved], received.laser_e[inner], atol=1.0)
    far = np.s_[:, : columns.min() - 5]
    np.testing.assert_array_equal(out.laser_e[far], received.laser_e[far])


def test_a_scene_without_a_suitable_body_is_unchanged(light: SceneLight, camera: Nominal) -> None:
    one_body = dataclasses.replace(light.left, body=np.ones(camera.shape, np.uint32))
    strengths = Strengths(nominal=camera, values={"body_offset": 3.0})
    received = ReceivedLight(laser_e=light.right.laser_e, rest_e=light.right.ambient_e)
    both = SceneLight(left=one_body, right=light.right)
    assert outside.displace_body(received, both, strengths, DRAWS) is received


def test_compression_keeps_block_means_and_removes_detail() -> None:
    dn = np.random.default_rng(0).uniform(50, 60, (20, 27))
    out = outside.compress(dn, 20.0)
    assert out.shape == dn.shape
    block = out[:8, :8]
    assert block.std() < 0.5 * dn[:8, :8].std()
    assert block.mean() == pytest.approx(dn[:8, :8].mean(), abs=20 / 16 + 0.1)
