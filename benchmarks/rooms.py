"""Compares generated rooms with measured indoor light: 10th, 50th and 90th percentiles of the lights' statistics.

    python benchmarks/rooms.py [--rooms 400]

Prints the table of docs/lights.md. Percentiles of sixteen maps are uncertain, so the last column has the 90 % range of
those of sixteen random rooms: measured values outside it differ significantly.
"""

import argparse

import numpy as np

from relight.lights import measure
from relight.lights.chain import generated_light

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


def main() -> None:
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


if __name__ == "__main__":
    main()
