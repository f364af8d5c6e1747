"""Computes intervals of means, and tests whether two rows of a table differ.

Scores are crossed: every figure is seen under every light, by every training of a row. All three are random factors of
the mean. The pairs (figure, light) are not independent samples, since they share figures and lights.

* The interval of a mean is a bootstrap of crossed factors (Owen 2007), which resamples whole figures and whole lights
  independently. For few levels percentile intervals are too narrow, so the resamples of a factor with n levels are
  expanded by sqrt(n/(n-1)) * t/z (Hesterberg 2015). Where neighbouring lights are not independent, as in `relit`, the
  resamples of lights are expanded by their covariance, too (Aronow, Samii and Assenova 2015).
* Two rows are compared by the differences of their pairs, in a two-way analysis of variance with random effects:
  Student's t with the degrees of freedom of Satterthwaite (Clark 1973). A bootstrap of a dozen figures is unreliable in
  the tails, where the corrected p-values of a table are: it makes several times too many false claims.
* Trainings are too few to resample. Their standard deviation is pooled over rows, and added as noise that follows
  Student's t with the pooled degrees of freedom.

A factor with one level cannot be resampled: the results then hold for that light, or that training, alone.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.stats import norm, t

CONFIDENCE = 0.95
ALPHA = 0.05  # significance level
RESAMPLES = 10_000  # of each interval
# Test subjects, with fewer of which nothing is decided: even if all n agree, the sign test has p = 2 / 2^n >= ALPHA.
MIN_SUBJECTS = 6


@dataclass
class Estimate:
    """A mean with its interval.

    Attributes:
        mean, low, high: the mean, and the ends of its 95 % interval.
        values: (F,L), the means over trainings for each figure and light.
        figures, lights: names of the rows and columns of `values`; rows of a table are paired by those that they share.
        error, freedom: the standard error of the mean due to trainings, and its degrees of freedom; 0 for a single
            training.
        best: whether it is the best network of its column in a table.
        p: p-value of the paired difference from the best, corrected over the table (Holm); None for the best itself and
            for baselines.
    """

    mean: float
    low: float
    high: float
    values: np.ndarray
    figures: list[str] = field(default_factory=list)
    lights: list[int] = field(default_factory=list)
    error: float = 0.0
    freedom: int = 0
    best: bool = False
    p: float | None = None

    @property
    def margin(self) -> float:
        """The half-width of the interval."""
        return (self.high - self.low) / 2

    @property
    def not_significant(self) -> bool:
        """Whether it does not differ significantly from the best value of its column."""
        return self.p is not None and self.p >= ALPHA


@dataclass
class Difference:
    """The difference of two rows.

    Attributes:
        mean: first minus second.
        p: two-sided p-value of the hypothesis that they are equal.
        error, freedom: the standard error of the mean and its degrees of freedom (Student's t); infinite and 1 if a
            row has fewer than MIN_SUBJECTS.
    """

    mean: float
    p: float
    error: float = np.inf
    freedom: float = 1.0

    def p_equivalent(self, bound: float) -> float:
        """Returns the p-value of a difference of `bound` or more, by two one-sided t-tests (Schuirmann 1987)."""
        if self.error == 0:
            return float(abs(self.mean) >= bound)
        return float(t.sf((bound - abs(self.mean)) / self.error, self.freedom))

    def half_width(self, alpha: float) -> float:
        """Returns half the width of the interval of confidence 1 - alpha."""
        return float(self.error * t.isf(alpha / 2, self.freedom)) if self.error else 0.0

    def bound(self, alpha: float) -> float:
        """Returns the least `bound` at which `p_equivalent` is `alpha`, so that larger differences are excluded."""
        return abs(self.mean) + self.half_width(2 * alpha)


@lru_cache(maxsize=8)
def resample_weights(levels: int, resamples: int, seed: int) -> np.ndarray:
    """Draws a bootstrap of a factor: the weights (B,N) of its N levels in each of B resamples, whose sum is 1."""
    generator = np.random.default_rng([seed, levels, resamples])
    return generator.multinomial(levels, np.full(levels, 1 / levels), resamples) / levels


@lru_cache
def _expansion_factor(levels: int) -> float:
    """Returns the factor by which resamples of a factor are expanded so that intervals match Student's t."""
    tail = (1 + CONFIDENCE) / 2
    return float(np.sqrt(levels / (levels - 1)) * t.ppf(tail, levels - 1) / norm.ppf(tail))


def _neighbours_factor(deviations: np.ndarray) -> float:
    """Returns the factor on the standard error of a mean of which each value has a cause in common with the next.

    `deviations` (L,) are those of the values from their mean, in a circle. With the variance v of a value and the
    covariance c of neighbours, the mean has the variance (v + 2c) / L. Unbiased estimates of v + 2c, and of v where c
    is 0, are the sums below over L - 3 and L - 1. The factor is at least 1, since c can be estimated but roughly; with
    fewer than four values it is unknown.
    """
    count, squares = len(deviations), float(deviations @ deviations)
    if count < 4 or not squares:
        return 1.0
    both = squares + 2 * float(deviations @ np.roll(deviations, 1))
    return float(np.sqrt(max(1.0, both / squares * (count - 1) / (count - 3))))


@dataclass
class Spread:
    """The standard deviation between trainings of their means, and its degrees of freedom; 0 if it is unknown."""

    deviation: float = 0.0
    freedom: int = 0


def pooled_spread(rows: list[np.ndarray]) -> Spread:
    """Pools the spread of trainings over rows, given the values (S,...) of the S trainings of each."""
    means = [values.reshape(len(values), -1).mean(1) for values in rows]
    freedom = sum(len(means_of_row) - 1 for means_of_row in means)
    squares = sum(((means_of_row - means_of_row.mean()) ** 2).sum() for means_of_row in means)
    return Spread(float(np.sqrt(squares / freedom)), freedom) if freedom else Spread()


def estimate(
    values: np.ndarray,
    spread: Spread | None = None,
    figures_and_lights: tuple[list[str], list[int]] = ([], []),
    noise_seed: int = 0,
    resamples: int = RESAMPLES,
    seed: int = 0,
    chained: bool = False,
) -> Estimate:
    """Estimates the mean of a row and its interval.

    Args:
        values: (S,F,L), by training, figure and light.
        spread: pooled over the table's trainings; a larger one of the row itself, with its own degrees of freedom, is
            preferred. Without it, the interval does not include the variation between trainings.
        figures_and_lights: the names of the F figures, and the indices of the L lights.
        noise_seed: seed of the noise that stands for the spread of trainings; another one for each row of a table.
        resamples: their number.
        seed: random seed of the resamples; rows with the same seed are resampled alike.
        chained: whether a value depends on the next light, too, as for relit pictures.

    Returns:
        The estimate. With one figure its interval is infinite; with one light it holds for that light only.
    """
    trainings, figures, lights = values.shape
    mean, pair_means = float(values.mean()), values.mean(0)
    error, freedom = 0.0, 0
    if spread and spread.freedom:
        larger = max(spread, pooled_spread([values]), key=lambda candidate: candidate.deviation)
        error, freedom = larger.deviation / np.sqrt(trainings), larger.freedom
    estimated = Estimate(mean, -np.inf, np.inf, pair_means, *figures_and_lights, error, freedom)
    if figures == 1:
        return estimated
    resampled = np.full(resamples, mean)
    for axis, levels in enumerate((figures, lights)):
        if levels > 1:
            weights = resample_weights(levels, resamples, seed + 1000 * axis)
            deviations = pair_means.mean(1 - axis) - mean
            factor = _neighbours_factor(deviations) if axis and chained else 1.0
            resampled += _expansion_factor(levels) * factor * (weights @ deviations)
    if freedom:
        resampled += error * np.random.default_rng([noise_seed, trainings]).standard_t(freedom, resamples)
    estimated.low, estimated.high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]).tolist()
    return estimated


def compare(first: Estimate, second: Estimate) -> Difference:
    """Compares two rows with Student's t.

    If both rows have the same figures, they are paired by figure; otherwise the figures are independent samples
    (Welch). The same holds for lights. The variance of the trainings is added to that over figures and lights.

    Args:
        first, second: estimates of one column.

    Returns:
        The difference first minus second; with an infinite interval and p = 1 if a row has fewer than MIN_SUBJECTS.
    """
    mean = float(first.mean - second.mean)
    if not (components := _variance_components(first, second)):
        return Difference(mean, p=1.0)
    if first.freedom == second.freedom:
        trainings = [(first.error**2 + second.error**2, first.freedom)]  # both have the pooled spread, one estimate
    else:
        trainings = [(row.error**2, row.freedom) for row in (first, second)]
    components += [component for component in trainings if component[1]]
    if (variance := sum(component for component, _ in components)) <= 0:
        return Difference(mean, p=float(mean == 0), error=0.0)
    freedom = float(variance**2 / sum(component**2 / n for component, n in components))  # Satterthwaite
    error = float(np.sqrt(variance))
    return Difference(mean, float(2 * t.sf(abs(mean) / error, freedom)), error, freedom)


def _variance_components(first: Estimate, second: Estimate) -> list[tuple[float, float]]:
    """Returns the variance components of the difference of two means over figures and lights (Clark 1973).

    The variance of the figures' means includes that of the interaction, and so does that of the lights' means, so the
    interaction is subtracted once, as a negative component. If a factor's own variance would be negative, it is zero.
    Each component has its degrees of freedom; there are none if a row has fewer than MIN_SUBJECTS.
    """
    rows = [first.values, second.values]
    shared_levels = [first.figures == second.figures, first.lights == second.lights]
    if min(len(values) for values in rows) < MIN_SUBJECTS:
        return []
    factors: list[list[tuple[float, float]]] = []  # the components of the figures, and those of the lights
    for axis, shared in enumerate(shared_levels):
        means = [values.mean(1 - axis) for values in rows]
        samples = [means[0] - means[1]] if shared else means
        factors.append([(sample.var(ddof=1) / len(sample), len(sample) - 1) for sample in samples if len(sample) > 1])
    pairs = [rows[0] - rows[1]] if all(shared_levels) else rows
    interaction: list[tuple[float, float]] = [
        (-_interaction(sample) / sample.size, (sample.shape[0] - 1) * (sample.shape[1] - 1)) for sample in pairs
    ]
    interaction = [component for component in interaction if component[1]]
    shared_variance = sum(variance for variance, _ in interaction)
    totals = [sum(variance for variance, _ in factor) + shared_variance for factor in factors]
    if not factors[1]:  # a single light
        return factors[0]
    return factors[int(np.argmax(totals))] if min(totals) <= 0 else [*factors[0], *factors[1], *interaction]


def _interaction(values: np.ndarray) -> float:
    """Returns the mean square of (F,L) after subtracting the means of rows and columns; 0 for one column."""
    residual = values - values.mean(1, keepdims=True) - values.mean(0) + values.mean()
    return float((residual**2).sum() / max((values.shape[0] - 1) * (values.shape[1] - 1), 1))


def holm(p: list[float]) -> np.ndarray:
    """Corrects p-values (N,) for multiple comparisons (Holm 1979)."""
    values = np.asarray(p, np.float64)
    order = np.argsort(values, kind="stable")
    steps = np.maximum.accumulate(values[order] * (len(values) - np.arange(len(values))))
    return np.minimum(steps, 1)[np.argsort(order)]
