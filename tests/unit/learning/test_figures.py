"""Metrics of classification: closed forms, and agreement with scikit-learn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from starling.learning.evaluation import metrics
from starling.learning.evaluation.metrics import Judged, judge, pool, reliability, roc
from starling.patterns.errors import InputError


def judged(probability, ndp) -> Judged:
    return judge(np.asarray(probability, np.float32), np.asarray(ndp, bool))


# Few distinct values, so that ties are frequent.
tied = st.lists(
    st.tuples(st.sampled_from([0.0, 0.1, 0.25, 0.5, 0.9, 1.0]), st.booleans()),
    min_size=2,
    max_size=60,
).filter(lambda pixels: 0 < sum(ndp for _, ndp in pixels) < len(pixels))


def test_a_perfect_ranking_has_area_1_and_no_ranking_one_half():
    perfect = roc(judged([0.1, 0.2, 0.3, 0.9], [0, 0, 0, 1]))
    assert perfect.area == 1.0
    assert perfect.true_positive_rate_at(0.0) == 1.0
    flat = roc(judged([0.0] * 10, [0] * 7 + [1] * 3))
    assert flat.area == 0.5
    assert flat.true_positive_rate_at(0.04) == pytest.approx(0.04)
    assert flat.true_positive_rate_at(1.0) == 1.0


def test_the_area_of_two_beta_distributions_has_its_closed_form():
    """Holes have sqrt(U), the rest U: P(sqrt(U) > V) = 2/3, TPR = 1 - (1 - FPR)^2."""
    rng = np.random.default_rng(0)
    report = np.concatenate([np.sqrt(rng.random(200_000)), rng.random(200_000)])
    curve = roc(judged(report, np.arange(400_000) < 200_000))
    assert curve.area == pytest.approx(2 / 3, abs=0.003)
    for rate in (0.04, 0.10, 0.5):
        expected = 1 - (1 - rate) ** 2
        assert curve.true_positive_rate_at(rate) == pytest.approx(expected, abs=0.004)


def test_the_rate_on_a_vertical_segment_is_its_upper_end():
    """Corners (0, 0), (0, 1/2), (1/2, 1/2), (1/2, 1), (1, 1)."""
    curve = roc(judged([0.9, 0.8, 0.7, 0.6], [1, 0, 1, 0]))
    rates = [curve.true_positive_rate_at(rate) for rate in (0.0, 0.25, 0.5, 0.75)]
    assert rates == [0.5, 0.5, 1.0, 1.0]


@given(tied)
def test_curve_and_scores_agree_with_scikit_learn(pixels):
    from sklearn import metrics as reference

    report, ndp = zip(*pixels, strict=True)
    ours, curve = judged(report, ndp), roc(judged(report, ndp))
    report = np.asarray(report, np.float32).astype(np.float64)
    across, up, _ = reference.roc_curve(ndp, report, drop_intermediate=False)
    np.testing.assert_allclose(curve.false_positive_rate, across)
    np.testing.assert_allclose(curve.true_positive_rate, up)
    assert curve.area == pytest.approx(reference.roc_auc_score(ndp, report))
    brier = reference.brier_score_loss(ndp, report)
    assert metrics.brier(ours) == pytest.approx(brier)
    inside = np.clip(report, 1e-6, 1 - 1e-6)
    loss = reference.log_loss(ndp, inside, labels=[False, True])
    assert metrics.log_loss(ours) == pytest.approx(loss)


@given(tied, st.randoms(use_true_random=False))
def test_metrics_do_not_depend_on_the_order_of_pixels(pixels, random):
    shuffled = random.sample(pixels, len(pixels))
    report, ndp = zip(*pixels, strict=True)
    told_other, ndp_other = zip(*shuffled, strict=True)
    first = metrics.classification(judged(report, ndp))
    second = metrics.classification(judged(told_other, ndp_other))
    for name in first.__slots__:
        assert getattr(first, name) == pytest.approx(getattr(second, name), abs=1e-12)


def test_skill_of_the_share_the_truth_and_wrong_certainty():
    ndp = [0] * 9 + [1]
    assert metrics.brier_skill(judged([0.1] * 10, ndp)) == pytest.approx(0, abs=1e-6)
    assert metrics.brier_skill(judged(ndp, ndp)) == 1.0
    # Perfect camera: Brier = share, so skill = 1 - 1 / (1 - share).
    assert metrics.brier_skill(judged([0.0] * 10, ndp)) == pytest.approx(1 - 1 / 0.9)
    assert np.isnan(metrics.brier_skill(judged([0.5], [1])))


def test_log_loss_of_the_share_and_of_wrong_certainty():
    entropy = -(0.1 * np.log(0.1) + 0.9 * np.log(0.9))
    share = judged([0.1] * 10, [0] * 9 + [1])
    assert metrics.log_loss(share) == pytest.approx(entropy, rel=1e-6)
    assert metrics.log_loss(judged([0.0], [1])) == pytest.approx(-np.log(1e-6))


def test_calibration_error_of_true_and_of_squared_probabilities():
    """Predicted p^2 where p is true, p uniform: E|p^2 - p| = 1/6; 15 bins resolve it to 1 %."""
    rng = np.random.default_rng(1)
    true = rng.random(300_000)
    ndp = rng.random(300_000) < true
    assert reliability(judged(true, ndp)).expected_calibration_error < 0.005
    result = reliability(judged(true**2, ndp)).expected_calibration_error
    assert result == pytest.approx(1 / 6, rel=0.01)


def test_bins_hold_equally_many_pixels_and_never_split_a_probability():
    spread = reliability(judged(np.linspace(0, 1, 100), np.arange(100) % 2), bins=10)
    assert spread.pixels.tolist() == [10] * 10
    report = [0.0] * 80 + [0.5] * 15 + [1.0] * 5
    grouped = reliability(judged(report, [0] * 84 + [1] * 16), bins=10)
    np.testing.assert_allclose(grouped.predicted, [0, 0.5, 1])
    assert grouped.pixels.tolist() == [80, 15, 5]
    np.testing.assert_allclose(grouped.observed, [0, 11 / 15, 1])
    assert reliability(judged([0.3, 0.6], [0, 1]), bins=15).pixels.tolist() == [1, 1]


def test_only_counted_pixels_count():
    report = np.array([[0.2, np.nan], [0.8, 7.0]], np.float32)
    ndp = np.array([[False, True], [True, False]])
    taken = judge(report, ndp, np.array([[True, False], [True, False]]))
    np.testing.assert_allclose(taken.probability, [0.2, 0.8])
    assert taken.share == 0.5


def test_rooms_pool_their_scenes_and_are_weighted_equally():
    good, bad = judged([0.1, 0.9], [0, 1]), judged([0.9, 0.1], [0, 1])
    rooms = metrics.by_room([("b", good), ("a", good), ("b", bad)])
    assert list(rooms) == ["a", "b"]
    assert rooms["a"].auc == 1.0
    assert rooms["b"] == metrics.classification(pool([good, bad]))
    assert metrics.mean(rooms).auc == pytest.approx((1.0 + rooms["b"].auc) / 2)
    worst = metrics.worst(rooms)
    assert worst.auc == rooms["b"].auc
    assert worst.brier == rooms["b"].brier > rooms["a"].brier


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: judged([0.5], [0, 1]), "probability, ndp and counted must share one shape"),
        (lambda: judge(np.ones(1), np.ones(1, bool), np.zeros(1, bool)), "counted must hold"),
        (lambda: judged([0.5, 1.5, np.nan], [0, 1, 1]), r"got 1.5 and 1 more"),
        (lambda: pool([]), "judged scenes must be at least one"),
        (lambda: roc(judged([0.5, 0.6], [1, 1])), "no-depth pixels must be some"),
        (lambda: roc(judged([0.5, 0.6], [0, 1])).true_positive_rate_at(4), "must be in"),
        (lambda: reliability(judged([0.5], [1]), bins=0), "bins must be in"),
        (lambda: metrics.by_room([("hall", judged([0.5], [1]))]), "room hall: no-depth"),
        (lambda: metrics.mean({}), "rooms must be at least one"),
        (lambda: metrics.worst({}), "rooms must be at least one"),
    ],
)
def test_invalid_pixels_are_refused_in_one_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_the_worst_room_has_the_greatest_error():
    good, bad = judged([0.1, 0.9], [0, 1]), judged([0.9, 0.1], [0, 1])
    rooms = metrics.by_room([("a", good), ("b", bad)])
    assert rooms["a"] != rooms["b"]
    assert metrics.worst(rooms) == rooms["b"]
