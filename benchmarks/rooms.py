"""Compares generated rooms with measured light: 10th, 50th and 90th percentiles of the lights' statistics.

    python benchmarks/rooms.py [--rooms 400]

Prints the tables of docs/lab/lights.md: rooms against sixteen indoor maps, and rooms and skies against the panoramas of
`relight light setup`. Percentiles of sixteen maps are uncertain, so the last column has the 90 % range of those of
sixteen random rooms: measured values outside it differ significantly.
"""

import argparse
from collections.abc import Iterable

import numpy as np

from relight.lights import load_light, measure
from relight.lights.chain import generated_light
from relight.panoramas import luminance, polyhaven
from relight.sh import basis, sphere_spiral

PERCENTILES = (10, 50, 90)
MAPS = 16
# Percentiles of 13 indoor panoramas and the published lights of St. Peter's, Galileo and Kitchen.
MEASURED = {
    "first": ("contrast, \\|L1\\| / L00", (0.57, 0.86, 1.16)),
    "second": ("structure, \\|L2\\| / L00", (0.30, 0.85, 1.62)),
    "elevation": ("elevation of the main direction", (11, 51, 81)),
    "up": ("from above / mean", (0.92, 1.46, 2.57)),
    "down": ("from below / mean", (0.16, 0.32, 0.57)),
    "side_least": ("darkest upright / mean", (0.19, 0.37, 0.80)),
    "side_most": ("brightest upright / mean", (1.05, 2.08, 2.37)),
    "red": ("ln R/G", (-0.19, 0.16, 0.38)),
    "blue": ("ln B/G", (-0.27, -0.08, 0.19)),
}

REAL = {
    "blue": "ln B/G",
    "red": "ln R/G",
    "first": "contrast, \\|L1\\| / L00",
    "second": "structure, \\|L2\\| / L00",
    "elevation": "elevation of the main direction",
    "up": "from above / mean",
    "down": "from below / mean",
    "darkest": "darkest normal / mean",
    "lobe": "darkest direction of the light itself, truncated at order 2, / mean",
}


def measured(sources: Iterable[str]) -> dict[str, np.ndarray]:
    """Measures lights by name: the statistics of REAL, (N,) each."""
    lights = np.stack([load_light(source).coefficients for source in sources])
    statistics = measure(lights)
    radiance = luminance(lights) @ basis(sphere_spiral(1000), 2).T
    mean = radiance.mean(1)
    return {**statistics, "darkest": statistics["least"] / statistics["mean"], "lobe": radiance.min(1) / mean}


def print_real(count: int) -> None:
    """Prints the table of real panoramas."""
    sets = {
        f"{len(polyhaven.NAMES)} real panoramas": measured(polyhaven.NAMES),
        f"{count} rooms": measured(f"room:{seed}" for seed in range(count)),
        f"{count // 4} skies": measured(f"sky:{seed}" for seed in range(count // 4)),
    }
    print(f"\n| | {' | '.join(sets)} |\n|---|{'---|' * len(sets)}")
    for name, title in REAL.items():
        columns = [np.round(np.percentile(statistics[name], PERCENTILES), 2) for statistics in sets.values()]
        print(f"| {title} | {' | '.join(', '.join(f'{value:.3g}' for value in column) for column in columns)} |")
    shares = [f"{(statistics['least'] < 0).mean():.1%}".replace("%", " %") for statistics in sets.values()]
    print(f"| lights with negative irradiance on some normal, at order 2 | {' | '.join(shares)} |")


def main() -> None:
    """Prints the percentiles of the lights of measured maps and of generated rooms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=400)
    count = parser.parse_args().rooms
    statistics = measure(np.stack([generated_light(f"room:{seed}", 2) for seed in range(count)]))
    drawn = np.random.default_rng(0).integers(0, count, (20000, MAPS))
    print(f"| | {MAPS} measured maps | {count} rooms | {MAPS} of the rooms at random |\n|---|---|---|---|")
    for name, (title, measured) in MEASURED.items():
        values = statistics[name]
        rooms = ", ".join(f"{value:.3g}" for value in np.round(np.percentile(values, PERCENTILES), 2))
        samples = np.percentile(values[drawn], PERCENTILES, axis=1)
        ranges = (f"{low:.2g} to {high:.2g}" for low, high in np.percentile(samples, (5, 95), axis=1).T)
        print(f"| {title} | {', '.join(map(str, measured))} | {rooms} | {', '.join(ranges)} |")
    print_real(count)


if __name__ == "__main__":
    main()
