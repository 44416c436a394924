"""Auto exposure: exposure time first, then gain."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.sim.imaging import imager
from tests.unit.sim.test_imager import REAL


@given(st.floats(1e-4, 1e2))
def test_auto_exposure_meets_its_level_or_its_limit(radiance):
    part = dataclasses.replace(REAL, auto_exposure_level=0.25)
    image = np.full((8, 8), radiance, np.float32)
    chosen = imager.choose_exposure(part, image, 850.0)
    electrons = imager.mean_electrons(part, image, 850.0, chosen)
    level = float(electrons.mean()) * part.dn_per_electron + part.black_level_dn
    at_limit = chosen.exposure_s == part.auto_exposure_max_s
    assert at_limit or level == pytest.approx(0.25 * part.ceiling_dn, rel=1e-4)
    assert level <= 0.25 * part.ceiling_dn * (1 + 1e-4)


@given(st.floats(1e-4, 1e2), st.sampled_from((0.0, 0.5, 4.0, 15.5)))
def test_gain_follows_the_longest_exposure(radiance, most):
    """Exposure first, then gain; the level is met if neither is at its limit."""
    part = dataclasses.replace(REAL, auto_exposure_level=0.25, auto_exposure_max_gain=most)
    image = np.full((8, 8), radiance, np.float32)
    chosen = imager.choose_exposure(part, image, 850.0)
    plain = imager.choose_exposure(
        dataclasses.replace(part, auto_exposure_max_gain=0.0), image, 850.0
    )
    assert chosen.exposure_s == plain.exposure_s
    assert part.gain <= chosen.gain <= max(most, part.gain)
    if chosen.gain > part.gain:
        assert chosen.exposure_s == part.auto_exposure_max_s
    if part.gain < chosen.gain < most:
        electrons = imager.mean_electrons(part, image, 850.0, chosen)
        level = float(electrons.mean()) * part.dn_per_electron * chosen.gain + part.black_level_dn
        assert level == pytest.approx(0.25 * part.ceiling_dn, rel=1e-4)


def test_the_middle_is_metered():
    image = np.full((20, 40), 5.0, np.float32)
    rows, columns = imager.metered_rows_columns(image.shape, 0.5)
    image[rows, columns] = 1.0
    assert (image == 1.0).sum() == image.size / 4
    part = dataclasses.replace(REAL, auto_exposure_level=0.25, auto_exposure_roi=0.5)
    even = imager.choose_exposure(part, np.ones_like(image), 850.0)
    assert imager.choose_exposure(part, image, 850.0) == even


def test_a_pixel_is_metered_at_least():
    rows, columns = imager.metered_rows_columns((2, 3), 0.05)
    assert np.ones((2, 3))[rows, columns].size >= 1
