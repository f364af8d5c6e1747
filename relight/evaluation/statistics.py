"""How sure a mean is, and whether two rows of a table differ.

The pairs (figure, light) of a test set share figures, so they are no independent samples: it is figures that are
resampled, whole, for the interval of a mean (cluster bootstrap). Few figures make percentile intervals too narrow; the
resamples are spread by sqrt(F/(F-1)) * t/z, as wide as Student's (the expanded interval of Hesterberg 2015).
Two rows are compared by their differences figure by figure, with Student's t: a table reads many p-values together,
far out in the tails, where the bootstrap of a dozen figures claims several times as often as it should.
Several trainings of a row add their own spread. Three are too few to resample, so the spread is pooled over rows, as in
an analysis of variance, and enters as noise that follows Student's t with the degrees of freedom of the pool.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, t

CONFIDENCE = 0.95


@dataclass
class Estimate:
    """A mean with its interval; values (F,): the mean over trainings of each figure; error, freedom: the standard error
    of that mean from training to training and its degrees of freedom, 0 when one training is all there is."""

    mean: float
    low: float
    high: float
    values: np.ndarray
    error: float = 0.0
    freedom: int = 0

    @property
    def margin(self) -> float:
        """Half the width of the interval."""
        return (self.high - self.low) / 2


@dataclass
class Difference:
    """First minus second: the mean, its interval, and the two-sided p-value of "no difference".

    error, freedom: the standard error of the mean and its degrees of freedom (Student's t); infinite and 1 where there
    are too few figures to know it.
    """

    mean: float
    low: float
    high: float
    p: float
    error: float = np.inf
    freedom: float = 1.0

    def p_equivalent(self, bound: float) -> float:
        """The p-value of "the two differ by `bound` or more": the larger of two one-sided t-tests (Schuirmann 1987)."""
        if self.error == 0:
            return float(abs(self.mean) >= bound)
        return float(t.sf((bound - abs(self.mean)) / self.error, self.freedom))


def resample_weights(figures: int, resamples: int, seed: int) -> np.ndarray:
    """(B,F) weights of each figure in each resample; rows sum to 1."""
    generator = np.random.default_rng([seed, figures, resamples])
    return generator.multinomial(figures, np.full(figures, 1 / figures), resamples) / figures


@dataclass
class Spread:
    """Standard deviation from training to training of a row's mean over figures, and its degrees of freedom."""

    deviation: float = 0.0
    freedom: int = 0


def pooled_spread(rows: list[np.ndarray]) -> Spread:
    """The spread of trainings, pooled over rows of values (S,F); rows of one training say nothing about it."""
    means = [values.mean(1) for values in rows]
    freedom = sum(len(one) - 1 for one in means)
    squares = sum(((one - one.mean()) ** 2).sum() for one in means)
    return Spread(float(np.sqrt(squares / freedom)), freedom) if freedom else Spread()


def estimate(values: np.ndarray, weights: np.ndarray, seed: int, spread: Spread | None = None) -> Estimate:
    """The mean of `values` (S,F), one row per training and one column per figure, and its interval.

    weights (B,F) from `resample_weights`. spread: that of the table's trainings; a row that spreads more keeps its own.
    `seed` draws its noise and must differ between the rows of a table. Without it the interval speaks of other figures
    only, not of another training. With one figure there is nothing to resample and the interval is infinite.
    """
    trainings, figures = values.shape
    mean, of_figures = float(values.mean()), values.mean(0)
    error, freedom = 0.0, 0
    if spread and spread.freedom:
        freedom = spread.freedom
        error = max(spread.deviation, pooled_spread([values]).deviation) / np.sqrt(trainings)
    if figures == 1:
        return Estimate(mean, -np.inf, np.inf, of_figures, error, freedom)
    tail = (1 + CONFIDENCE) / 2
    wider = np.sqrt(figures / (figures - 1)) * t.ppf(tail, figures - 1) / norm.ppf(tail)
    draws = mean + wider * (weights @ (of_figures - mean))
    if freedom:
        draws += error * np.random.default_rng([seed, trainings]).standard_t(freedom, len(weights))
    return Estimate(mean, *interval(draws), of_figures, error, freedom)


def interval(draws: np.ndarray) -> tuple[float, float]:
    """The central CONFIDENCE interval of resamples."""
    low, high = np.quantile(draws, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def compare(first: Estimate, second: Estimate) -> Difference:
    """The paired difference of two rows on the same figures: Student's t over figures and, where rows were trained
    several times, over trainings as well (their variances added, degrees of freedom by Welch and Satterthwaite)."""
    differences = first.values - second.values
    return student(first, second, [(differences.var(ddof=1), len(differences))] if len(differences) > 1 else [])


def compare_apart(first: Estimate, second: Estimate) -> Difference:
    """The difference of two means over different figures, by Welch's t."""
    several = len(first.values) > 1 and len(second.values) > 1
    return student(
        first, second, [(one.values.var(ddof=1), len(one.values)) for one in (first, second)] if several else []
    )


def student(first: Estimate, second: Estimate, samples: list[tuple[float, int]]) -> Difference:
    """The difference of two means whose noise is that of `samples`, (variance, size), and of the trainings."""
    mean = float(first.mean - second.mean)
    if not samples:
        return Difference(mean, -np.inf, np.inf, 1.0)
    parts = [(variance / size, size - 1) for variance, size in samples]
    if freedom := max(first.freedom, second.freedom):
        parts.append((first.error**2 + second.error**2, freedom))
    variance = sum(part for part, _ in parts)
    if variance == 0:
        return Difference(mean, mean, mean, float(mean == 0), 0.0)
    freedom = variance**2 / sum(part**2 / n for part, n in parts)
    reach = t.ppf((1 + CONFIDENCE) / 2, freedom) * np.sqrt(variance)
    p = 2 * t.sf(abs(mean) / np.sqrt(variance), freedom)
    return Difference(mean, *map(float, (mean - reach, mean + reach, p, np.sqrt(variance), freedom)))


def holm(p: list[float]) -> np.ndarray:
    """Holm's correction of p-values that are read together: the chance of one false claim among all stays at p."""
    values = np.asarray(p, np.float64)
    order = np.argsort(values, kind="stable")
    steps = np.maximum.accumulate(values[order] * (len(values) - np.arange(len(values))))
    corrected = np.empty_like(values)
    corrected[order] = np.minimum(steps, 1)
    return corrected
