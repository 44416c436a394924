"""Means ignore unknown values, and are unknown without any known value."""

from __future__ import annotations

import warnings

import numpy as np

from starling.sim.arrays import mean_known


def test_unknown_values_do_not_count():
    values = np.array([[1.0, np.nan, np.nan], [3.0, 5.0, np.nan]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        over_rows, over_all = mean_known(values, 0), mean_known(values, (0, 1))
    np.testing.assert_array_equal(over_rows, [2.0, 5.0, np.nan])
    assert over_all == 3.0


def test_where_all_is_known_it_is_the_mean():
    values = np.random.default_rng(3).normal(size=(4, 5, 6))
    np.testing.assert_allclose(mean_known(values, (0, 2)), values.mean(axis=(0, 2)), rtol=1e-12)
