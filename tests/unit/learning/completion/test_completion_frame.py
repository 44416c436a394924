"""Validation of frames, and frames without holes or without depth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from starling.learning.completion.method import (
    CANNOT,
    NOTHING,
    Completed,
    CompletionFrame,
    complete,
    make_frame,
)
from starling.patterns.errors import InputError

DEPTH = np.linspace(0.5, 2, 12, dtype=np.float32).reshape(3, 4)
VALID = DEPTH < 1.5
GREY = np.full((3, 4), 128, np.uint8)


class Mean:
    """Fills holes with the mean."""

    name = "mean"

    def fill(self, frame: CompletionFrame) -> Completed:
        depth = np.where(frame.valid, frame.depth_m, np.nanmean(frame.depth_m))
        return Completed(depth_m=depth, sigma_m=np.zeros_like(depth))


def test_image_of_any_kind_becomes_three_channels_of_0_to_1() -> None:
    for image in (GREY, np.repeat(GREY[..., None], 3, 2), GREY.astype(np.uint16) * 257):
        frame = make_frame(image, DEPTH, VALID)
        assert frame.rgb.shape == (3, 4, 3)
        np.testing.assert_allclose(frame.rgb, 128 / 255, atol=1e-6)
    np.testing.assert_array_equal(
        make_frame(GREY / 255, DEPTH, VALID).rgb[..., 0], GREY / np.float32(255)
    )


def test_values_in_holes_have_no_effect() -> None:
    inputs = np.where(VALID, DEPTH, -np.inf)
    np.testing.assert_array_equal(np.isnan(make_frame(GREY, inputs, VALID).depth_m), ~VALID)


@pytest.mark.parametrize(
    ("image", "depth", "valid", "message"),
    [
        (None, DEPTH, VALID, "rgb must be given; got none. "),
        (
            GREY,
            DEPTH[0],
            VALID,
            "depth_m and valid must be (h, w) of one size; got (4,) and (3, 4). ",
        ),
        (GREY[:2], DEPTH, VALID, "rgb and depth_m must have one size; got (2, 4) and (3, 4). "),
        (np.zeros((3, 4, 4)), DEPTH, VALID, "rgb must be (h, w, 3) or (h, w); got (3, 4, 4). "),
        (
            GREY.astype(np.int64),
            DEPTH,
            VALID,
            "rgb must be uint8, uint16 or floating point; got int64. ",
        ),
        (GREY[:0], DEPTH[:0], VALID[:0], "rgb must have pixels; got (0, 4). "),
        (GREY * 1.0, DEPTH, VALID, "rgb must be 0..1 in floating point; got 128 to 128. "),
        (GREY, -DEPTH, VALID, "depth_m must be finite and > 0 where valid; got -0.5. "),
        (GREY, DEPTH * np.nan, VALID, "depth_m must be finite and > 0 where valid; got nan. "),
        (GREY, DEPTH * np.inf, VALID, "depth_m must be finite and > 0 where valid; got inf. "),
        (GREY, DEPTH * 1000, VALID, "depth_m must be in metres; got a median of "),
    ],
)
def test_refused(image: Any, depth: Any, valid: Any, message: str) -> None:
    with pytest.raises(InputError) as error:
        complete(Mean(), image, depth, valid)
    assert str(error.value).startswith(message)


def test_holes_are_filled() -> None:
    result = complete(Mean(), GREY, DEPTH, VALID)
    np.testing.assert_array_equal(result.depth_m[VALID], DEPTH[VALID])
    assert np.isfinite(result.depth_m).all() and not result.note


def test_a_frame_without_depth_is_not_completed() -> None:
    result = complete(Mean(), GREY, DEPTH, np.zeros_like(VALID))
    assert (
        result.note == CANNOT and np.isnan(result.depth_m).all() and np.isnan(result.sigma_m).all()
    )


def test_a_frame_without_holes_is_returned() -> None:
    result = complete(Mean(), GREY, DEPTH, np.ones_like(VALID))
    assert result.note == NOTHING
    np.testing.assert_array_equal(result.depth_m, DEPTH)
