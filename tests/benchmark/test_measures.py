from dataclasses import replace

import numpy as np
import pytest
from samples import ssim_in_the_box
from skimage.metrics import mean_squared_error

from relight.benchmark.measures import INVARIANCES, LEAKS, MARGIN, MIRROR, Intrinsics, errors, invariances, leaks
from relight.benchmark.shots import variants
from relight.core.srgb import decode, encode, to_bytes
from relight.evaluation.scoring.metrics import irradiance_error
from relight.maps.square import crop_around
from relight.sh import irradiance, sphere_quadrature

SIDE = 24
SHOTS = variants(lambda gain: np.zeros((40, 40, 3), np.uint8), np.full((40, 40), 255, np.uint8), SIDE)


@pytest.fixture
def two():
    rng = np.random.default_rng(1)
    row, column = np.mgrid[:SIDE, :SIDE]
    mask = np.hypot(row - 12, 1.5 * (column - 11)) < 10
    channels = {"albedo": 3, "transport": 9, "shading": 3}
    maps = [{name: rng.uniform(0, 1, (SIDE, SIDE, n)) for name, n in channels.items()} for _ in range(2)]
    return tuple(Intrinsics(mask, **each, light=rng.normal(size=(9, 3))) for each in maps)


def rmse(first, second, inside):
    return (mean_squared_error(first[inside], second[inside]) * first.shape[2]) ** 0.5


def test_errors_agree_with_scikit_image(two):
    seen, true = two
    found = errors(seen, true)
    for name in ("albedo", "shading", "transport"):
        assert np.isclose(found[name], rmse(getattr(seen, name), getattr(true, name), true.mask))
    for name in ("albedo", "shading"):
        values, expected = getattr(seen, name), getattr(true, name)
        best = min(np.linspace(0.01, 2, 400), key=lambda f: rmse(f * values, expected, true.mask))
        assert np.isclose(found[f"{name}_factor"], rmse(best * values, expected, true.mask), atol=1e-4)
        assert np.isclose(found[f"{name}_ssim"], ssim_in_the_box(values, expected, true.mask))
    # The norm of irradiance over the sphere, by quadrature.
    directions, weights = sphere_quadrature(8)
    first, second = (irradiance(one.light, directions) for one in (seen, true))
    norm = np.sqrt((weights[:, None] * (first - second) ** 2).sum() / (weights[:, None] * second**2).sum())
    assert np.isclose(found["light"], norm) and found["light_factor"] <= found["light"]


def mirrored(seen: Intrinsics) -> Intrinsics:
    maps = {name: getattr(seen, name)[:, ::-1] for name in ("mask", "albedo", "shading")}
    return Intrinsics(**maps, transport=seen.transport[:, ::-1] * MIRROR, light=seen.light * MIRROR[:, None])


def test_invariances_of_an_ideal_method(two):
    usual = two[0]
    seen = dict.fromkeys(SHOTS, usual) | {"mirror": mirrored(usual)}
    seen["dark"] = replace(usual, shading=usual.shading / 2)
    seen["warm"] = replace(usual, shading=usual.shading * [1.2, 1, 1 / 1.2])
    found = invariances(seen)
    assert set(found) == set(INVARIANCES)
    ideal = {name: {"dark_albedo": 1.0, "dark_shading": 0.5, "tint": 1.0}.get(name, 0.0) for name in INVARIANCES}
    for name, value in ideal.items():
        assert np.isclose(found[name], value, atol=2e-3), name


@pytest.mark.parametrize("black", ["", "knee", "warm", "plain", "mirror", "all", "but the picture"])
def test_a_black_answer_counts(two, black):
    """A black light is as far from any other as that is from black, and black shading has no tint."""
    dark = replace(two[0], light=np.zeros((9, 3)), shading=np.zeros_like(two[0].shading))
    chosen = {"all": set(SHOTS), "but the picture": {*SHOTS} - {""}}.get(black, {black})
    found = invariances({name: dark if name in chosen else two[0] for name in SHOTS})
    assert set(found) == set(INVARIANCES) and np.isfinite([*found.values()]).all()
    assert found["knee"] == pytest.approx(float(black in ("", "knee", "but the picture")))
    assert found["tint"] == 0 or black in ("warm", "plain")
    measured = errors(dark, dark) | {f"of {name}": value for name, value in errors(two[0], dark).items()}
    assert np.isfinite([*measured.values()]).all() and (measured["light"], measured["of light"]) == (0, 1)


def test_invariances_depend_on_their_own_variant(two):
    usual, other = two
    still = dict.fromkeys(SHOTS, usual) | {"mirror": mirrored(usual)}
    moves = irradiance_error(other.light, usual.light)
    for variant, share, row in (
        ("down_4", 0.5, "shift_4"), ("right_8", 0.5, "shift_8"), ("larger", 1, "larger"), ("smaller", 1, "smaller"),
        ("fatter", 1, "fatter"), ("thinner", 1, "thinner"), ("knee", 1, "knee"), ("waist", 1, "waist"),
    ):  # fmt: skip
        found = invariances(still | {variant: replace(usual, light=other.light)})
        assert np.isclose(found[row], share * moves)
        assert all(np.isclose(v, 0) for k, v in found.items() if k != row and k not in ("dark_albedo", "dark_shading"))


def test_leaks_of_known_edges_and_of_flat_maps():
    """Albedo's edges copied by half into the shading, and every second row brighter."""
    rng = np.random.default_rng(3)
    size = 64
    mask = np.arange(size)[:, None].repeat(size, 1) > 0
    edges = np.exp(0.3 * rng.normal(size=(size, size)))[..., None].repeat(3, 2)
    copied = leaks(Intrinsics(mask, albedo=edges, shading=edges**0.5))
    assert np.isclose(copied["edges"], 1) and np.isclose(copied["transfer"], 0.5, atol=1e-6)
    clean = leaks(Intrinsics(mask, albedo=edges, shading=np.exp(0.3 * rng.normal(size=edges.shape))))
    assert abs(clean["edges"]) < 0.1
    steps = np.where(np.arange(size) % 2, 0.3, 0.1)  # from an odd to an even pixel the step is three times as long
    shading = np.exp(np.add.outer(np.cumsum(steps), 0.2 * np.arange(size)) - 12)[..., None].repeat(3, 2) + 0.02
    striped = leaks(Intrinsics(mask, albedo=edges, shading=np.maximum(shading, 0.02)))
    assert np.isclose(striped["stripes"], 0.5, atol=0.05)  # (.3 - .1) / .2 down, 0 across
    flat = np.full((32, 32, 3), 0.5)
    assert leaks(Intrinsics(np.ones((32, 32), bool), albedo=flat, shading=flat)) == dict.fromkeys(LEAKS, 0.0)
    for rows in (0, 2 * MARGIN + 1):  # nothing is left, or a line, which has no neighbours above
        assert leaks(Intrinsics((np.arange(32) < rows)[:, None] & np.ones(32, bool), albedo=flat, shading=flat)) == {}


def test_variants_of_a_picture():
    y, x = np.mgrid[:96, :80]
    mask = ((np.abs(x - 30) < 14) & (np.abs(y - 50) < 40)).astype(np.uint8) * 255
    linear = np.stack([x / 200, y / 200, (x + y) / 400], -1)
    shots = variants(lambda gain: to_bytes(encode(linear * gain)), mask, SIDE)
    usual = shots[""]
    assert usual.square == crop_around(mask, SIDE)
    pixel = usual.square.side / SIDE
    assert np.isclose(shots["down_4"].square.top - usual.square.top, 4 * pixel)
    assert np.isclose(shots["right_8"].square.left - usual.square.left, 8 * pixel)
    larger = shots["larger"].square
    assert np.isclose(larger.side, 1.15 * usual.square.side)
    assert np.isclose(larger.top + larger.side / 2, usual.square.top + usual.square.side / 2)
    assert (shots["fatter"].mask >= mask).all() and (shots["fatter"].mask > mask).any()
    assert (shots["thinner"].mask <= mask).all() and (shots["thinner"].mask < mask).any()
    for name, share in (("knee", 0.72), ("waist", 0.5)):
        left = (shots[name].mask > 127).any(1).sum() / (mask > 127).any(1).sum()
        assert np.isclose(left, share, atol=0.02) and shots[name].square.side < usual.square.side
    assert np.array_equal(shots["mirror"].photo[:, ::-1], usual.photo)
    assert np.abs(decode(shots["dark"].photo / 255) - linear / 2).max() < 0.01
    balance = decode(shots["warm"].photo / 255)[50, 30] / decode(shots["plain"].photo / 255)[50, 30]
    assert np.allclose(balance, [1.2, 1, 1 / 1.2], atol=0.05)
