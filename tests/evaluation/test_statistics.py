import numpy as np
import pytest
from scipy import stats

from relight.evaluation.scoring.scores import Scores
from relight.evaluation.scoring.statistics import Estimate, compare, estimate, holm, pooled_spread
from relight.evaluation.scoring.tables import estimates

RNG = np.random.default_rng(5)


def test_estimate_interval_agrees_with_students():
    values = RNG.normal(2, 0.3, (1, 40, 1))
    found = estimate(values, resamples=20000)
    low, high = stats.t.interval(0.95, 39, values.mean(), stats.sem(values[0, :, 0]))
    assert found.mean == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.006)


def test_estimate_interval_coverage():
    """Figures, lights and trainings differ: 95 % intervals cover the true mean in 95 % of 400 experiments."""
    covered = 0
    for trial in range(400):
        rng = np.random.default_rng(trial)
        rows = 1 + rng.normal(0, 0.1, (3, 3, 1, 1)) + rng.normal(0, 0.05, (3, 3, 10, 8))
        rows += rng.normal(0, 0.2, (10, 1)) + rng.normal(0, 0.2, 8)
        found = estimate(rows[0], pooled_spread(list(rows)), noise_seed=trial, resamples=400, seed=trial)
        covered += found.low <= 1 <= found.high
    assert 0.925 <= covered / 400 <= 0.985


def test_estimate_interval_of_values_that_share_a_light_with_the_next():
    """Light n lights value n, and by another but correlated amount value n - 1: the standard error is known."""
    squares, covered, lights, correlation = [], 0, 10, 0.4
    for trial in range(500):
        rng = np.random.default_rng(trial)
        own = rng.normal(0, 1, lights)
        new = correlation * own + np.sqrt(1 - correlation**2) * rng.normal(0, 1, lights)
        values = np.broadcast_to(own + np.roll(new, -1), (1, 2, lights))
        found = estimate(values, resamples=400, seed=trial, chained=True)
        squares.append((found.margin / stats.t.ppf(0.975, lights - 1)) ** 2)
        covered += found.low <= 0 <= found.high
    assert np.mean(squares) == pytest.approx((2 + 2 * correlation) / lights, rel=0.1) and covered / 500 > 0.9


@pytest.mark.parametrize("column", ["relit_rmse", "shading_rmse"])
def test_only_relit_pictures_depend_on_the_next_light(column):
    values = np.repeat(np.sin(np.arange(20) * np.pi / 10)[None], 8, 0)  # slow waves: neighbours are alike
    rows = {"a": [Scores([str(i) for i in range(8)], list(range(20)), {column: values})]}
    found, apart = estimates(rows, column, {})["a"].margin, estimate(values[None]).margin
    assert found == pytest.approx(apart * np.sqrt((1 + 2 * np.cos(np.pi / 10)) * 19 / 17) ** (column == "relit_rmse"))


def test_compare_agrees_with_the_paired_t_test_and_over_other_figures_with_welch():
    first, second, other = RNG.normal(0, 1, 9), RNG.normal(0, 1, 9), RNG.normal(0.5, 2, 14)
    paired = compare(*(estimate(row[None, :, None], resamples=100) for row in (first, second)))
    rows = (Estimate(v.mean(), 0, 0, v[:, None], figures=list(range(len(v))), lights=[0]) for v in (first, other))
    of_scipy = stats.ttest_rel(first, second), stats.ttest_ind(first, other, equal_var=False)
    for found, expected in zip((paired, compare(*rows)), of_scipy):
        interval, half = expected.confidence_interval(), found.half_width(0.05)
        assert found.p == pytest.approx(expected.pvalue)
        assert (found.mean - half, found.mean + half) == pytest.approx((interval.low, interval.high))


def test_compare_crossed_variance_of_the_mean_squares():
    """Of a two-way layout: (MS_figure + MS_light - MS_pair) / FL, degrees of freedom by Satterthwaite."""
    figures, lights = 7, 5
    values = RNG.normal(0, 1, (figures, 1)) + RNG.normal(0, 1.5, lights) + RNG.normal(0, 0.3, (figures, lights))
    other = RNG.normal(0, 1, (figures, lights))
    given = [estimate(one[None], resamples=10) for one in (values + other, other)]
    grand = values.mean()
    degrees = (figures - 1, lights - 1, (figures - 1) * (lights - 1))
    rest = values - values.mean(1, keepdims=True) - values.mean(0) + grand
    squares = [lights * values.mean(1).var(ddof=1), figures * values.mean(0).var(ddof=1), (rest**2).sum() / degrees[2]]
    variance = (squares[0] + squares[1] - squares[2]) / (figures * lights)
    freedom = (variance * figures * lights) ** 2 / sum(square**2 / n for square, n in zip(squares, degrees))
    found = compare(*given)
    assert (found.mean, found.error, found.freedom) == pytest.approx((grand, np.sqrt(variance), freedom))
    assert found.p == pytest.approx(2 * stats.t.sf(abs(grand) / np.sqrt(variance), freedom))
    assert found.bound(0.05) == pytest.approx(abs(grand) + stats.t.ppf(0.95, freedom) * np.sqrt(variance))
    assert found.p_equivalent(found.bound(0.05)) == pytest.approx(0.05)


def test_variance_components_are_not_negative():
    """Means of lights that are closer than the pairs' noise makes them: the variance is that over figures alone."""
    noise = RNG.normal(0, 1, (6, 4))
    values = noise - noise.mean(0) + RNG.normal(0, 2, (6, 1))
    found = compare(estimate(values[None], resamples=10), estimate(np.zeros((1, 6, 4)), resamples=10))
    assert (found.p, found.freedom) == (pytest.approx(stats.ttest_1samp(values.mean(1), 0).pvalue), 5)


def test_compare_p_values_of_equal_rows_are_uniform():
    """5 % of 600 comparisons of rows that are alike fall under .05, although their lights differ in common."""
    found = []
    for trial in range(600):
        rng = np.random.default_rng(trial)
        rows = rng.normal(0, 1, (16, 1)) + rng.normal(0, 0.1, (2, 3, 16, 6)) + rng.normal(0, 0.05, (2, 3, 1, 1))
        rows += rng.normal(0, 0.1, (2, 1, 1, 6))  # of each row under each of six lights
        found.append(compare(*(estimate(row, pooled_spread(list(rows)), resamples=2) for row in rows)).p)
    assert 0.02 <= np.mean(np.array(found) < 0.05) <= 0.075 and np.mean(np.array(found) < 0.01) <= 0.025


@pytest.mark.parametrize("seed", range(4))
def test_compare_rows_that_share_one_factor(seed):
    """Other figures under the same lights: what the lights do to both rows alike falls out; and the other way round."""
    rng = np.random.default_rng(seed)
    shared, own = rng.normal(0, 1, 8), rng.normal(0, 0.01, (2, 12, 8))
    rows = [Estimate(v.mean(), 0, 0, v, figures=[i], lights=[0]) for i, v in enumerate(shared + own)]
    assert compare(*rows).error < 0.01
    turned = [Estimate(r.mean, 0, 0, r.values.T, figures=[0], lights=[i]) for i, r in enumerate(rows)]
    assert compare(*turned).error == pytest.approx(compare(*rows).error)
    apart = [Estimate(r.mean, 0, 0, r.values, figures=[i], lights=[i]) for i, r in enumerate(rows)]
    assert compare(*apart).error > 0.2


def test_estimate_interval_with_the_spread_of_trainings():
    figures = np.linspace(0.9, 1.1, 16)[:, None]
    calm, wild = np.stack([figures, figures, figures]), np.stack([figures - 0.1, figures, figures + 0.1])
    spread = pooled_spread([wild, wild, calm[:1]])
    assert (spread.deviation, spread.freedom) == (pytest.approx(0.1), 4)
    student, still = stats.t.ppf(0.975, 4) * 0.1, estimate(calm, resamples=4000).margin
    for rows, expected in ((calm, student / np.sqrt(3)), (wild, student / np.sqrt(3)), (calm[:1], student)):
        assert estimate(rows, spread, resamples=4000).margin == pytest.approx(np.hypot(still, expected), rel=0.05)
    assert pooled_spread([calm[:1]]).freedom == 0


def test_holm_by_hand():
    np.testing.assert_allclose(holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(holm([0.6, 0.7]), [1, 1])
    assert len(holm([])) == 0
