"""Input channels of networks."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
import pytest

from starling.learning.data.example import Example
from starling.learning.networks import channels
from starling.patterns.errors import InputError
from starling.sim.reason import Reason
from tests.unit.learning.step_scenes import INFO, SHAPE, step_scene


def _channel(example: Example, name: str) -> np.ndarray:
    everything = {"with_reflectance": True, "with_physics": True}
    return channels.channels(example, **everything)[channels.names(**everything).index(name)]


def _with_physics(example: Example, **changes: Any) -> Example:
    assert example.physics is not None
    return dataclasses.replace(example, physics=dataclasses.replace(example.physics, **changes))


def test_a_slanted_plane_has_its_gradient_and_incidence() -> None:
    """A plane n . x = 1 has d = f b (n_x u + n_y v + n_z) for rays (u, v)."""
    u = (np.arange(SHAPE[1]) - INFO.cx_px) / INFO.fx_px
    v = ((np.arange(SHAPE[0]) - INFO.cy_px) / INFO.fy_px)[:, None]
    normal = np.array([0.5, -0.25, 1.0])
    inverse = normal[0] * u + normal[1] * v + normal[2]
    example = dataclasses.replace(step_scene(0), depth_m=(1 / inverse).astype(np.float32))
    fb = INFO.focal_baseline_px_m
    inner = (slice(4, -4), slice(4, -4))
    across, down = (_channel(example, name)[inner] for name in ("across", "down"))
    np.testing.assert_allclose(across, fb * normal[0] / INFO.fx_px, atol=1e-5)
    np.testing.assert_allclose(down, fb * normal[1] / INFO.fy_px, atol=1e-5)
    np.testing.assert_allclose(_channel(example, "disparity"), fb * inverse / 32, rtol=1e-5)
    cosine = inverse / np.linalg.norm(normal) / np.sqrt(1 + u**2 + v**2)
    np.testing.assert_allclose(_channel(example, "incidence")[inner], cosine[inner], atol=1e-4)
    np.testing.assert_allclose(_channel(example, "off_axis"), np.hypot(u, v), rtol=1e-5)


@pytest.mark.parametrize("with_reflectance", [False, True])
def test_uninformative_physics_has_the_logit_of_the_share(
    with_reflectance: bool,
) -> None:
    order = channels.names(with_reflectance=with_reflectance, with_physics=True)
    values = dict(channels.uninformative(0.2, with_reflectance=with_reflectance))
    assert {order[number] for number in values} == {*channels.PHYSICS, *channels.REASONS}
    logit = values.pop(order.index("logit")) / channels.LOGIT_SCALE
    assert 1 / (1 + np.exp(-logit)) == pytest.approx(0.2)
    assert set(values.values()) == {0.0}


def test_a_vertical_flip_flips_channels_and_signs() -> None:
    """The assumption of the vertical flip; the principal point is at the centre."""
    example = step_scene(3)
    slanted = example.depth_m * np.linspace(1, 1.2, SHAPE[0], dtype=np.float32)[:, None]
    example = dataclasses.replace(example, depth_m=slanted)
    turned = dataclasses.replace(example, depth_m=slanted[::-1])
    alone = {"with_reflectance": False, "with_physics": False}
    for name, upright, over in zip(
        channels.names(**alone),
        channels.channels(example, **alone),
        channels.channels(turned, **alone),
        strict=True,
    ):
        sign = -1 if name in channels.ODD else 1
        np.testing.assert_allclose(over, sign * upright[::-1], atol=1e-4, err_msg=name)


def test_unknown_reference_and_physics_give_no_nan() -> None:
    example = step_scene(1)
    depth, reflectance = example.depth_m.copy(), np.full(SHAPE, 0.5, np.float32)
    depth[10:20, 5:30] = np.nan
    reflectance[:, 3:6] = np.nan
    example = dataclasses.replace(example, depth_m=depth, reflectance=reflectance)
    example = _with_physics(example, disparity_px=np.full(SHAPE, np.nan, np.float32))
    seen = channels.channels(example, with_reflectance=True, with_physics=True)
    assert seen.dtype == np.float32
    assert np.isfinite(seen).all()
    np.testing.assert_array_equal(_channel(example, "known"), np.isfinite(depth))
    assert not _channel(example, "matched").any()


def test_every_reason_has_one_channel_and_depth_has_none() -> None:
    listed = list(itertools.chain(*channels.REASONS.values()))
    assert sorted(listed) == sorted(set(Reason) - {Reason.VALID})


def test_the_right_border_of_the_overlap_changes_sign() -> None:
    example = step_scene(2)
    disparity = INFO.disparity_px(example.depth_m)
    outside = np.arange(SHAPE[1]) < disparity
    np.testing.assert_array_equal(_channel(example, "right_column") < 0, outside)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depth_m": np.ones((8, 9), np.float32)}, "depth_m must be 64x48"),
        ({"depth_m": np.full(SHAPE, np.nan, np.float32)}, "must be known somewhere"),
        ({"reflectance": None}, "reflectance must be given"),
        ({"reflectance": np.ones((8, 9), np.float32)}, "reflectance must be 64x48"),
        ({"physics": None}, "physics must be given"),
    ],
)
def test_missing_images_and_other_sizes_are_refused(changes: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        example = dataclasses.replace(step_scene(0), **changes)
        channels.channels(example, with_reflectance=True, with_physics=True)


@pytest.mark.parametrize("name", ["ndp", "infrared", "contrast"])
def test_physics_that_is_not_finite_is_refused(name: str) -> None:
    image = np.full(SHAPE, 0.5, np.float32)
    image[3, 4] = np.nan
    with pytest.raises(InputError, match=f"physics {name} must be finite.*1 pixels in scene0"):
        example = _with_physics(step_scene(0), **{name: image})
        channels.channels(example, with_reflectance=False, with_physics=True)


def test_refuses_physics_of_another_size() -> None:
    example = _with_physics(step_scene(0), contrast=np.ones((8, 9), np.float32))
    with pytest.raises(InputError, match="physics contrast must be 64x48"):
        channels.channels(example, with_reflectance=False, with_physics=True)
