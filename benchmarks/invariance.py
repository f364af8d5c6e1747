"""What a network for photographs gets wrong, and what it lets move that must not: light, transport and albedo of one
person under another framing, mask, exposure, white balance or in the mirror.

    python benchmarks/invariance.py relight/weights/photo.safetensors [other.safetensors ...]

Prints a table with a column for each network. The figures (seeds 9000 to 9005, in no training set), lit by six rooms
that no training has, are drawn and baked at 512 px once and kept in --cache. Everything goes through the same code as
`relight photo`. Light errors are of irradiance: the norm of the difference over the norm. A light that is always the
same passes every invariance: read those rows beside the errors.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from relight.lights import Light
from relight.lights.chain import generated_light
from relight.maps import Maps, read_maps, write_maps
from relight.photos.api import Relighter, load
from relight.photos.frame import Frame, frame
from relight.photos.infer import Figure
from relight.progress import progress
from relight.sh import cosine_factors, per_coefficient
from relight.srgb import encode, to_bytes

SEEDS = range(9000, 9006)
ROOMS = range(50000, 50006)
SIZE = 512
IRRADIANCE = per_coefficient(cosine_factors(2))[:, None]
MIRROR = np.ones(9)
MIRROR[[3, 4, 7]] = -1  # the coefficients that are odd in x
BEHIND = 0.18  # linear value of the plain background that a mask which is too fat takes in


def figures(cache: Path) -> list[Maps]:
    """The baked figures; drawn and baked where `cache` has none."""
    from transport import figure

    from relight.transport import bake

    cache.mkdir(parents=True, exist_ok=True)
    for seed in progress(SEEDS, "figures"):
        path = cache / f"{seed}.exr"
        if not path.exists():
            write_maps(path, bake(figure(None, seed), SIZE, 256, supersample=2))
    return [read_maps(cache / f"{seed}.exr") for seed in SEEDS]


def photographed(maps: Maps, light: np.ndarray, gain: np.ndarray | float = 1.0) -> np.ndarray:
    """The 8-bit photograph (H,W,3) of a figure under light (9,3); gain: on each channel, before the camera clips."""
    linear = maps.albedo * np.maximum(maps.transport @ light, 0)
    coverage = maps.coverage[..., None]
    return to_bytes(encode(np.clip((linear * coverage + BEHIND * (1 - coverage)) * gain, 0, 1)))


def masked(maps: Maps) -> np.ndarray:
    """The mask (H,W) uint8 with soft edges."""
    return to_bytes(maps.coverage)


def distance(light: np.ndarray, other: np.ndarray) -> float:
    """|difference| / |other| of the irradiance of two lights (9,3)."""
    return float(np.linalg.norm((light - other) * IRRADIANCE) / np.linalg.norm(other * IRRADIANCE))


def factor(values: np.ndarray, other: np.ndarray) -> float:
    """What to multiply `values` by to come nearest to `other`: how bright a scene is, no photograph tells."""
    return float((values * other).sum() / max((values**2).sum(), 1e-9))


def rms(difference: np.ndarray) -> float:
    """Root of the mean over pixels of the squared norm of vectors (P,C)."""
    return float(np.sqrt((difference**2).sum(-1).mean()))


def leak(albedo: np.ndarray, shading: np.ndarray, mask: np.ndarray) -> dict[str, float]:
    """How much of the albedo's edges is in the shading, of maps (S,S,3) and mask (S,S).

    edges: correlation of the differences between neighbours of ln albedo and ln shading; transfer: regression of the
    shading's on the albedo's at the strongest 5 % of these; gradient: mean |difference| of ln shading.
    """
    inside = binary_erosion(mask, iterations=4)
    maps = [np.log(np.maximum(x.mean(-1), 0.02)) for x in (albedo, shading)]
    a, s = (np.concatenate([steps(x, inside, axis) for axis in (0, 1)]) for x in maps)
    strong = np.abs(a) > np.quantile(np.abs(a), 0.95)
    return {
        "edges": float(np.corrcoef(a, s)[0, 1]),
        "transfer": float((a[strong] * s[strong]).sum() / (a[strong] ** 2).sum()),
        "gradient": float(np.abs(s).mean()),
    }


def steps(values: np.ndarray, inside: np.ndarray, axis: int, phase: int | None = None) -> np.ndarray:
    """Differences of (S,S) between neighbours along an axis that are both inside; phase: from even or odd pixels."""
    both = inside[1:] & inside[:-1] if axis == 0 else inside[:, 1:] & inside[:, :-1]
    if phase is not None:
        both = both & (np.indices(both.shape)[axis] % 2 == phase)
    return np.diff(values, axis=axis)[both]


def stripes(shading: np.ndarray, mask: np.ndarray) -> float:
    """(max - min) / mean of mean |difference| of ln shading from even and from odd pixels; mean over the two axes."""
    inside, found = binary_erosion(mask, iterations=4), []
    values = np.log(np.maximum(shading.mean(-1), 0.02))
    for axis in (0, 1):
        means = [np.abs(steps(values, inside, axis, phase)).mean() for phase in (0, 1)]
        found.append((max(means) - min(means)) / np.mean(means))
    return float(np.mean(found))


def moved(box: Frame, down: float, right: float, larger: float) -> Frame:
    """The square shifted by network pixels and enlarged about its centre."""
    pixel, side = box.side / box.size, box.side * larger
    offset = (box.side - side) / 2
    return replace(box, top=box.top + down * pixel + offset, left=box.left + right * pixel + offset, side=side)


def truth(maps: Maps, light: np.ndarray, box: Frame) -> dict[str, np.ndarray]:
    """The true maps (S,S,C) at the network's pixels; they hold inside its mask."""
    coverage = np.maximum(box.crop(maps.coverage), 1e-3)[..., None]
    albedo, transport = (box.crop(x * maps.coverage[..., None]) / coverage for x in (maps.albedo, maps.transport))
    return {"albedo": albedo, "transport": transport, "shading": np.maximum(transport @ light, 0)}


def judged(relighter: Relighter, maps: Maps, light: np.ndarray) -> dict[str, float]:
    """All rows of the table for one figure under one light."""
    photo, coverage = photographed(maps, light), masked(maps)
    box = frame(coverage, relighter.network.size)
    usual = relighter.look(photo, coverage, box)
    true = truth(maps, light, box)
    rows = {f"error of {name}": rms((getattr(usual, name) - true[name])[usual.mask]) for name in true}
    rows = {"error of light": distance(usual.light, light), **rows}
    rows["error of light, up to a factor"] = distance(usual.light * factor(usual.light, light), light)
    for name in ("albedo", "shading"):
        found, expected = getattr(usual, name)[usual.mask], true[name][usual.mask]
        rows[f"error of {name}, up to a factor"] = rms(found * factor(found, expected) - expected)

    def shift(down: float, right: float, larger: float = 1.0) -> float:
        return distance(relighter.look(photo, coverage, moved(box, down, right, larger)).light, usual.light)

    rows["shifted by 4 px"] = np.mean([shift(4, 0), shift(0, 4)])
    rows["shifted by 8 px"] = np.mean([shift(8, 0), shift(0, 8)])
    rows["square 15 % larger"] = shift(0, 0, 1.15)
    rows["square 7 % smaller"] = shift(0, 0, 0.93)
    pixel = max(1, round(box.side / box.size))
    for name, change in (("fatter", binary_dilation), ("thinner", binary_erosion)):
        wrong = change(coverage > 127, iterations=pixel).astype(np.uint8) * 255
        rows[f"mask 1 px {name}"] = distance(relighter.look(photo, wrong, box).light, usual.light)
    solid = np.flatnonzero((coverage > 127).any(1))
    for name, share in (("knee", 0.72), ("waist", 0.5)):
        cut = coverage.copy()
        cut[solid[0] + int(share * len(solid)) :] = 0
        rows[f"cut at the {name}"] = distance(relighter.infer(photo, cut, split=False)[0].light, usual.light)
    other = relighter.infer(photo[:, ::-1], coverage[:, ::-1], split=False)[0]
    both = usual.mask & other.mask[:, ::-1]
    rows["mirror: light"] = distance(other.light * MIRROR[:, None], usual.light)
    rows["mirror: transport"] = rms((other.transport[:, ::-1] * MIRROR - usual.transport)[both])
    rows["mirror: albedo"] = rms((other.albedo[:, ::-1] - usual.albedo)[both])
    dark = relighter.look(photographed(maps, light, 0.5), coverage, box)
    for name in ("albedo", "shading"):
        change = (getattr(dark, name) + 1e-3) / (getattr(usual, name) + 1e-3)
        rows[f"exposure x .5: {name}"] = float(np.median(change[usual.mask]))
    warm = relighter.look(photographed(maps, light, np.array([1.2, 1.0, 1 / 1.2]) / 1.44), coverage, box)
    plain = relighter.look(photographed(maps, light, 1 / 1.44), coverage, box)
    tint = np.log(mean_shading(warm) / mean_shading(plain))
    rows["share of a tint that goes to the light"] = float((tint[0] - tint[2]) / np.log(1.44))
    found = leak(usual.albedo, usual.shading, usual.mask)
    rows["correlation of the edges of albedo and shading"] = found["edges"]
    rows["albedo's strongest edges in the shading"] = found["transfer"]
    rows["mean gradient of ln shading"] = found["gradient"]
    rows["stripes in the shading"] = stripes(usual.shading, usual.mask)
    return rows


def of_truth(maps: Maps, light: np.ndarray, size: int) -> dict[str, float]:
    """What the rows of leaks and stripes are for the true maps."""
    coverage = masked(maps)
    box = frame(coverage, size)
    mask = box.crop(coverage) >= 128
    true = truth(maps, light, box)
    found = leak(true["albedo"], true["shading"], mask)
    return {
        "exposure x .5: albedo": 1.0,
        "exposure x .5: shading": 0.5,
        "share of a tint that goes to the light": 1.0,
        "correlation of the edges of albedo and shading": found["edges"],
        "albedo's strongest edges in the shading": found["transfer"],
        "mean gradient of ln shading": found["gradient"],
        "stripes in the shading": stripes(true["shading"], mask),
    }


def mean_shading(figure: Figure) -> np.ndarray:
    return figure.shading[figure.mask].mean(0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path, nargs="+")
    parser.add_argument("--cache", type=Path, default=Path("results/invariance"), help="of the figures' maps")
    args = parser.parse_args()
    people = figures(args.cache)
    lights = [Light(generated_light(f"room:{room}", 2), f"room:{room}").normalised().coefficients for room in ROOMS]
    columns = {}
    for path in args.weights:
        relighter = load(path, threads=1)
        rows = [judged(relighter, maps, light) for maps, light in progress(list(zip(people, lights)), path.stem)]
        columns[str(path)] = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    rows = [of_truth(maps, light, relighter.network.size) for maps, light in zip(people, lights)]
    columns["truth"] = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    print("| | " + " | ".join(columns) + " |\n|---|" + "---|" * len(columns))
    for name in next(iter(columns.values())):
        cells = (f"{column[name]:.3f}" if name in column else "" for column in columns.values())
        print(f"| {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
