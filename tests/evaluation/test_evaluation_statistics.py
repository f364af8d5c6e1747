import numpy as np
import pytest
from scipy import stats

from relight.evaluation.statistics import compare, estimate, holm, interval, pooled_spread, resample_weights

RNG = np.random.default_rng(5)


def test_weights_are_resamples_of_the_figures():
    weights = resample_weights(7, 500, 1)
    np.testing.assert_allclose(weights.sum(1), 1)
    np.testing.assert_allclose(weights * 7, np.round(weights * 7))
    assert weights.var(0).mean() == pytest.approx((1 / 7) * (6 / 7) / 7, rel=0.1)  # multinomial: p (1-p) / F
    assert np.array_equal(weights, resample_weights(7, 500, 1))
    assert not np.array_equal(weights, resample_weights(7, 500, 2))


def test_interval_agrees_with_students_for_normal_figures():
    values = RNG.normal(2, 0.3, (1, 40))
    found = estimate(values, resample_weights(40, 20000, 0), 0)
    low, high = stats.t.interval(0.95, 39, values.mean(), stats.sem(values[0]))
    assert found.mean == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.006)


@pytest.mark.parametrize(("figures", "trainings"), [(16, 1), (8, 1), (16, 3)])
def test_intervals_cover_the_truth_as_often_as_they_say(figures, trainings):
    """Both the figures and the trainings differ: 95 % intervals cover the true mean in 95 % of 400 experiments."""
    covered = 0
    for trial in range(400):
        rng = np.random.default_rng(trial)
        rows = rng.normal(0, 0.1, (3, trainings, 1)) * (trainings > 1) + rng.normal(0, 0.05, (3, trainings, figures))
        rows += 1 + rng.normal(0, 0.2, figures)
        found = estimate(rows[0], resample_weights(figures, 600, trial), trial, pooled_spread(list(rows)))
        covered += found.low <= 1 <= found.high
    assert 0.925 <= covered / 400 <= 0.98


def test_differences_agree_with_the_paired_t_test():
    first, second = RNG.normal(0, 1, (2, 9))
    weights = resample_weights(9, 100, 0)
    found = compare(estimate(first[None], weights, 0), estimate(second[None], weights, 1))
    expected = stats.ttest_rel(first, second)
    interval = expected.confidence_interval()
    assert (found.p, found.low, found.high) == pytest.approx((expected.pvalue, interval.low, interval.high))


@pytest.mark.parametrize("trainings", [1, 3])
def test_p_values_of_equal_rows_are_uniform(trainings):
    """5 % of 1000 comparisons of rows that are alike fall under .05, and 1 % under .01."""
    found = []
    for trial in range(1000):
        rng = np.random.default_rng(trial)
        rows = rng.normal(0, 1, 16) + rng.normal(0, 0.1, (2, trainings, 16))
        rows += rng.normal(0, 0.05, (2, trainings, 1)) * (trainings > 1)
        weights, spread = resample_weights(16, 2, trial), pooled_spread(list(rows))
        found.append(compare(*(estimate(row, weights, s, spread) for s, row in enumerate(rows))).p)
    assert 0.025 <= np.mean(np.array(found) < 0.05) <= 0.07
    assert np.mean(np.array(found) < 0.01) <= 0.02


def test_pairing_finds_what_the_intervals_hide():
    """A shift far under the spread of the figures: the rows' intervals overlap, their paired difference is sure."""
    shared = RNG.normal(1, 0.3, 16)
    weights = resample_weights(16, 2000, 0)
    first = estimate(shared[None], weights, 0)
    second = estimate((shared + 0.02 + RNG.normal(0, 0.002, 16))[None], weights, 1)
    found = compare(first, second)
    assert first.high > second.low
    assert found.high < 0 and found.p < 0.005
    assert found.mean == pytest.approx(-0.02, abs=0.003)


def test_the_spread_of_trainings_widens_the_interval():
    weights, figures = resample_weights(16, 4000, 0), np.linspace(0.9, 1.1, 16)
    calm, wild = np.stack([figures, figures, figures]), np.stack([figures - 0.1, figures, figures + 0.1])
    spread = pooled_spread([wild, wild, calm[:1]])
    assert (spread.deviation, spread.freedom) == (pytest.approx(0.1), 4)
    student, still = stats.t.ppf(0.975, 4) * 0.1, estimate(calm, weights, 0).margin
    for rows, expected in ((calm, student / np.sqrt(3)), (wild, student / np.sqrt(3)), (calm[:1], student)):
        assert estimate(rows, weights, 0, spread).margin == pytest.approx(np.hypot(still, expected), rel=0.05)
    assert pooled_spread([calm[:1]]).freedom == 0


def test_few_figures_cannot_be_sure():
    weights = resample_weights(2, 2000, 0)
    first, second = (estimate(np.array([row]), weights, 0) for row in ([0.5, 0.6], [0.7, 0.9]))
    assert compare(first, second).p > 0.1
    one = resample_weights(1, 100, 0)
    first, second = (estimate(np.array([[value]]), one, 0) for value in (0.5, 0.7))
    assert (first.low, first.high, first.mean) == (-np.inf, np.inf, 0.5)
    assert compare(first, second).p == 1
    assert compare(first, first).p == 1


def test_interval_of_known_draws():
    assert interval(np.arange(1001.0)) == pytest.approx((25, 975))


def test_holm_by_hand():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.6, 0.7]), [1, 1])
    assert len(holm([])) == 0
