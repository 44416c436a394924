"""The case study: pose errors in each method's depth, and their difference from real depth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from starling.learning.icp import case_study, objects, study
from starling.learning.icp.study import Disturbance, Outcome
from starling.patterns.errors import InputError
from tests.unit.learning.drawn_scene import INFO, depth

SMALL = Disturbance(most_m=0.02, most_deg=8)


@pytest.fixture(scope="module")
def pieces() -> list[objects.Piece]:
    return objects.in_room(depth(), INFO, scene="s", room="r")


def align(pieces: list[objects.Piece], trials: int = 2, seed: int = 0, **images: np.ndarray):
    return study.align(pieces, depth(), images, INFO, disturbance=SMALL, trials=trials, seed=seed)


def test_equal_depth_has_no_difference(pieces):
    result = align(pieces, real=depth(), same=depth().copy())
    compared = case_study.against_real(result["same"], result["real"])
    assert compared.difference == (0, 0, 0, 0)
    assert (compared.trials, compared.objects, compared.only_in_real, compared.only_in_method) == (
        2,
        1,
        0,
        0,
    )
    assert (result["real"].position_m < 1e-3).all()


def test_the_seed_determines_the_trials(pieces):
    item, same, second = (align(pieces, seed=s, real=depth())["real"] for s in (0, 0, 1))
    np.testing.assert_array_equal(item.position_m, same.position_m)
    assert (item.position_m != second.position_m).all()
    assert item.objects == ("s/1",) or item.objects[0].startswith("s/")


def test_a_depth_error_gives_a_position_error(pieces):
    """All depth 1 % farther: the object's error is 1 % of its distance, +-20 %."""
    result = align(pieces, real=depth(), far=(depth() * 1.01).astype(np.float32))
    distance = np.linalg.norm(pieces[0].centre_m)
    assert result["far"].position_m == pytest.approx(np.full((1, 2), 0.01 * distance), rel=0.2)


def test_hidden_objects_are_counted_and_excluded(pieces):
    hidden = np.where(pieces[0].pixels, np.nan, depth()).astype(np.float32)
    result = align(pieces, real=depth(), hides=hidden)
    assert not result["hides"].visible.any()
    assert np.isnan(result["hides"].rotation).all()
    compared = case_study.against_real(result["hides"], result["real"])
    assert np.isnan(compared.difference).all()
    assert (compared.objects, compared.only_in_real, compared.trials) == (0, 1, 0)
    nothing = align(pieces, real=depth(), blind=np.full_like(depth(), np.nan))
    assert not nothing["blind"].visible.any()
    both = study.pool([result, align(pieces, seed=1, real=depth(), hides=depth())])
    compared = case_study.against_real(both["hides"], both["real"])
    assert (compared.objects, compared.only_in_real, compared.only_in_method, compared.trials) == (
        1,
        1,
        0,
        2,
    )
    assert case_study.against_real(both["real"], both["hides"]).only_in_method == 1


def outcome(position: np.ndarray) -> Outcome:
    names = tuple(f"s/{i}" for i in range(len(position)))
    return Outcome(objects=names, position_m=position, rotation=position / 10)


def test_figures_are_those_of_the_paper():
    real = outcome(np.array([[1.0, 3.0], [5.0, 7.0]]))  # Mean 4, variance 5.
    method = outcome(np.array([[2.0, 2.0], [4.0, 6.0]]))  # Mean 3.5, variance 2.75.
    result = case_study.against_real(method, real).difference
    np.testing.assert_allclose(result, [12.5, 45.0, 12.5, 45.0])
    assert result._fields[0] == "position_mean_pct"


def test_the_interval_of_a_nearer_method_is_above_zero():
    draw = np.random.default_rng(0)
    errors = draw.gamma(2.0, 0.01, (60, 5))
    real, near = outcome(errors), outcome(errors * 1.05)
    far = outcome(errors * 1.6)
    gain = case_study.paired_advantage(near, far, real, seed=0, draws=500)
    assert min(gain.low) > 0
    assert gain.middle.position_mean_pct == pytest.approx(60 - 5, abs=1e-6)
    assert gain.middle.position_var_pct == pytest.approx(156 - 10.25, rel=1e-6)
    back = case_study.paired_advantage(far, near, real, seed=0, draws=500)
    np.testing.assert_allclose(back.high, np.negative(gain.low))
    same = case_study.paired_advantage(near, near, real, seed=0, draws=500)
    assert same.low == same.high == (0, 0, 0, 0)


def test_the_interval_of_equal_methods_contains_zero():
    """Two methods of the same distribution, over 40 sets of 30 objects.

    About 95 % of the intervals contain zero; fewer than 33 of 40 have a probability of 0.001.
    """
    held = 0
    for seed in range(40):
        draw = np.random.default_rng(seed)
        real, item, second = (outcome(draw.gamma(4.0, 0.01, (30, 4))) for _ in range(3))
        gain = case_study.paired_advantage(item, second, real, seed=seed, draws=300)
        held += gain.low.position_mean_pct <= 0 <= gain.high.position_mean_pct
    assert held >= 33


def test_invalid_studies_are_refused(pieces):
    with pytest.raises(InputError, match=r"trials must be an integer in \[2, 1000000\]; got 1"):
        align(pieces, trials=1, real=depth())
    with pytest.raises(InputError, match="pieces must hold an object; got 0"):
        align([], real=depth())
    with pytest.raises(InputError, match="method of reference must be a known name; got 'real'"):
        align(pieces, other=depth())
    with pytest.raises(InputError, match="depth of real must be of shape"):
        align(pieces, real=depth()[:10])


def test_outcomes_of_different_objects_are_refused():
    item = outcome(np.ones((2, 2)))
    with pytest.raises(InputError, match="scenes must not be empty; got 0"):
        study.pool([])
    with pytest.raises(InputError, match="scenes must share methods and trials; got 2"):
        study.pool([{"real": item}, {"real": outcome(np.ones((2, 3)))}])
    with pytest.raises(InputError, match="objects must be the same in both; got 2 and 3"):
        case_study.against_real(item, outcome(np.ones((3, 2))))
    with pytest.raises(InputError, match="draws must be an integer in"):
        case_study.paired_advantage(item, item, item, seed=0, draws=10)
    single = outcome(np.array([[1.0, 2.0]]))
    with pytest.raises(InputError, match="objects seen in all must be two or more; got 1"):
        case_study.paired_advantage(single, single, single, seed=0)


def test_real_zero_gives_no_figure():
    still = outcome(np.zeros((2, 2)))
    assert np.isnan(case_study.against_real(still, still).difference).all()
    moved = dataclasses.replace(still, position_m=np.ones((2, 2)))
    assert np.isnan(case_study.against_real(moved, still).difference).all()
