"""How sure a mean is, and whether two rows of a table differ.

The scores of a test are crossed: every figure is seen under every light, by every training of a row. Other figures,
other lights and another training would each give another mean, so all three are sources of its spread. The pairs
(figure, light) are not independent samples: they share figures and lights.

* The interval of a mean resamples figures and lights, whole and apart from each other (bootstrap of crossed factors,
  Owen 2007). Few of them make percentile intervals too narrow; the resamples of each factor of n levels are spread by
  sqrt(n/(n-1)) * t/z, as wide as Student's (the expanded interval of Hesterberg 2015).
* Two rows are compared by their differences pair by pair, with a two-way analysis of variance with random effects and
  Student's t, degrees of freedom by Satterthwaite (Clark 1973): a table reads many p-values together, far out in the
  tails, where the bootstrap of a dozen figures claims several times as often as it should.
* Trainings are too few to resample. Their spread is pooled over rows and enters as noise that follows Student's t with
  the degrees of freedom of the pool.

A factor with one level cannot be resampled: the numbers then speak of that light, or of that training, alone.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.stats import norm, t

CONFIDENCE = 0.95
ALPHA = 0.05  # p-values under it are significant


@dataclass
class Estimate:
    """A mean with its interval.

    Attributes:
        mean, low, high: the mean, and the ends of its 95 % interval.
        values: (F,L), the mean over trainings of each pair of figure and light.
        figures, lights: what the pairs are of; two rows are compared pair by pair in what they share.
        error, freedom: the standard error of the mean from training to training and its degrees of freedom, 0 when one
            training is all there is.
        best: whether it is the best network of its column in a table.
        p: of the paired difference from the best, corrected for all that the table compares (Holm); None for the best
            itself and for baselines.
    """

    mean: float
    low: float
    high: float
    values: np.ndarray
    figures: list = field(default_factory=list)
    lights: list = field(default_factory=list)
    error: float = 0.0
    freedom: int = 0
    best: bool = False
    p: float | None = None

    @property
    def margin(self) -> float:
        """Half the width of the interval."""
        return (self.high - self.low) / 2

    @property
    def undecided(self) -> bool:
        """Whether it cannot be told from the best value of its column."""
        return self.p is not None and self.p >= ALPHA


@dataclass
class Difference:
    """The difference of two rows, first minus second.

    Attributes:
        mean, low, high: the mean, and the ends of its 95 % interval.
        p: two-sided, of "they are equal".
        error, freedom: the standard error of the mean and its degrees of freedom (Student's t); infinite and 1 where
            there are too few figures to know it.
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

    def bound(self, alpha: float) -> float:
        """The least `bound` at which `p_equivalent` is under `alpha`: the difference is shown to be smaller."""
        reach = self.error * t.isf(alpha, self.freedom) if self.error else 0.0
        return float(abs(self.mean) + reach)


@lru_cache(maxsize=8)
def resample_weights(levels: int, resamples: int, seed: int) -> np.ndarray:
    """(B,N) weights of each of the N levels of a factor in each resample; rows sum to 1."""
    generator = np.random.default_rng([seed, levels, resamples])
    return generator.multinomial(levels, np.full(levels, 1 / levels), resamples) / levels


@lru_cache
def widening(levels: int) -> float:
    """The factor that makes the spread of resamples as wide as Student's (Hesterberg 2015)."""
    tail = (1 + CONFIDENCE) / 2
    return float(np.sqrt(levels / (levels - 1)) * t.ppf(tail, levels - 1) / norm.ppf(tail))


@dataclass
class Spread:
    """Standard deviation from training to training of a row's mean over the pairs, and its degrees of freedom."""

    deviation: float = 0.0
    freedom: int = 0


def pooled_spread(rows: list[np.ndarray]) -> Spread:
    """Pools the spread of trainings over rows.

    Args:
        rows: values (S,...) of each, over trainings; rows of one training tell nothing of it.
    """
    means = [values.reshape(len(values), -1).mean(1) for values in rows]
    freedom = sum(len(one) - 1 for one in means)
    squares = sum(((one - one.mean()) ** 2).sum() for one in means)
    return Spread(float(np.sqrt(squares / freedom)), freedom) if freedom else Spread()


def estimate(
    values: np.ndarray,
    resamples: int,
    seed: int,
    spread: Spread | None = None,
    pairs: tuple[list, list] = ([], []),
    noise: int = 0,
) -> Estimate:
    """The mean of a row's values and its interval.

    Args:
        values: (S,F,L), one per training, figure and light.
        resamples: how many.
        seed: of the resamples; rows with the same seed are resampled alike.
        spread: that of the table's trainings; a row that spreads more keeps its own. Without it the interval does not
            speak of another training.
        pairs: the figures and the lights.
        noise: seed of the noise of the trainings; it must differ between the rows of a table.

    Returns:
        The estimate; with one figure there is nothing to resample and its interval is infinite. With one light it
        speaks of that light only.
    """
    trainings, figures, lights = values.shape
    mean, of_pairs = float(values.mean()), values.mean(0)
    error, freedom = 0.0, 0
    if spread and spread.freedom:
        freedom = spread.freedom
        error = max(spread.deviation, pooled_spread([values]).deviation) / np.sqrt(trainings)
    found = Estimate(mean, -np.inf, np.inf, of_pairs, list(pairs[0]), list(pairs[1]), error, freedom)
    if figures == 1:
        return found
    draws = np.full(resamples, mean)
    for axis, levels in enumerate((figures, lights)):
        if levels > 1:
            weights = resample_weights(levels, resamples, seed + 1000 * axis)
            draws += widening(levels) * (weights @ (of_pairs.mean(1 - axis) - mean))
    if freedom:
        draws += error * np.random.default_rng([noise, trainings]).standard_t(freedom, resamples)
    found.low, found.high = interval(draws)
    return found


def interval(draws: np.ndarray) -> tuple[float, float]:
    """The central CONFIDENCE interval of resamples."""
    low, high = np.quantile(draws, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def compare(first: Estimate, second: Estimate) -> Difference:
    """Compares two rows with Student's t.

    Figures that both rows have are compared figure by figure, and lights light by light; others as independent samples
    (Welch). To the variance over figures and lights that of the trainings is added.

    Args:
        first, second: estimates of one column.

    Returns:
        First minus second; with an infinite interval and p = 1 where a row has one figure.
    """
    mean = float(first.mean - second.mean)
    parts = crossed(first, second)
    if not parts:
        return Difference(mean, -np.inf, np.inf, 1.0)
    if trainings := max(first.freedom, second.freedom):
        parts.append((first.error**2 + second.error**2, trainings))
    variance = sum(part for part, _ in parts)
    if variance <= 0:
        return Difference(mean, mean, mean, float(mean == 0), 0.0)
    freedom = variance**2 / sum(part**2 / n for part, n in parts)
    reach = t.ppf((1 + CONFIDENCE) / 2, freedom) * np.sqrt(variance)
    p = 2 * t.sf(abs(mean) / np.sqrt(variance), freedom)
    return Difference(mean, *map(float, (mean - reach, mean + reach, p, np.sqrt(variance), freedom)))


def crossed(first: Estimate, second: Estimate) -> list[tuple[float, float]]:
    """Splits the variance of the difference of two means over figures and lights (Clark 1973).

    The variance of the means of figures holds that of figures and that of the pairs, and so does that of lights: the
    pairs' is taken away once (a negative part). A factor whose own variance would come out negative has none.

    Args:
        first, second: estimates of one column.

    Returns:
        Parts of the variance with their degrees of freedom; none where a row has one figure.
    """
    rows = [first.values, second.values]
    alike = [getattr(first, name) == getattr(second, name) for name in ("figures", "lights")]
    if min(len(values) for values in rows) < 2:
        return []
    factors: list[list[tuple[float, float]]] = []
    for axis, shared in enumerate(alike):
        means = [values.mean(1 - axis) for values in rows]
        samples = [means[0] - means[1]] if shared else means
        factors.append([(one.var(ddof=1) / len(one), len(one) - 1) for one in samples if len(one) > 1])
    pairs = [rows[0] - rows[1]] if all(alike) else rows
    between: list[tuple[float, float]] = [
        (-_interaction(one) / one.size, (one.shape[0] - 1) * (one.shape[1] - 1)) for one in pairs
    ]
    between = [part for part in between if part[1]]
    own = [sum(part for part, _ in factor) + sum(part for part, _ in between) for factor in factors]
    if not factors[1] or own[1] <= 0:
        return factors[0]
    return factors[1] if own[0] <= 0 else [*factors[0], *factors[1], *between]


def _interaction(values: np.ndarray) -> float:
    """The mean square of what is left of (F,L) without the means of its rows and columns; 0 for one column."""
    left = values - values.mean(1, keepdims=True) - values.mean(0) + values.mean()
    return float((left**2).sum() / max((values.shape[0] - 1) * (values.shape[1] - 1), 1))


def holm(p: list[float]) -> np.ndarray:
    """Corrects p-values that are read together (Holm 1979): the chance of one false claim among all stays at p.

    Args:
        p: (N,).

    Returns:
        (N,), in the same order.
    """
    values = np.asarray(p, np.float64)
    order = np.argsort(values, kind="stable")
    steps = np.maximum.accumulate(values[order] * (len(values) - np.arange(len(values))))
    corrected = np.empty_like(values)
    corrected[order] = np.minimum(steps, 1)
    return corrected
