import numpy as np
import pytest
from samples import ssim_in_the_box
from skimage.metrics import mean_squared_error, structural_similarity

from relight.evaluation.scoring.truth import Inferred, Truth, light_errors
from relight.settings.scores import COLUMNS, QUANTITIES
from relight.sh import unoccluded

FOUR = ("rmse", "rmse_element", "ssim", "ssim_range2")
RNG = np.random.default_rng(3)


@pytest.fixture
def truth():
    """A ragged mask at the edge of a 40 px image, under three lights that leave some shadings negative."""
    size = 40
    mask = np.zeros((size, size), bool)
    mask[5:31, 23:40] = RNG.random((26, 17)) < 0.8
    mask[5, 26] = mask[30, 26] = mask[9, 23] = mask[9, 39] = True
    pixel = np.flatnonzero(mask)
    normal = RNG.normal(size=(len(pixel), 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ao = RNG.uniform(0.2, 1, (len(pixel), 1)).astype(np.float32)
    lights = RNG.normal(0.1, 0.4, (3, 9, 3)).astype(np.float32)
    maps = {"transport": unoccluded(normal) * ao, "albedo": RNG.random((len(pixel), 3)), "normal": normal, "ao": ao}
    return Truth(pixel, maps, lights, size), mask, lights


def noisy(truth: Truth, name: str, count: int) -> np.ndarray:
    values = np.repeat(truth.maps[name], count, 0)
    return (values + RNG.normal(0, 0.2, values.shape)).astype(np.float32)


def readings(inferred: np.ndarray, true: np.ndarray, mask: np.ndarray, span: float) -> tuple[float, ...]:
    """The four readings of compact maps (P,C), by scikit-image."""
    square, pictures = mean_squared_error(inferred, true), np.zeros((2, *mask.shape, inferred.shape[1]))
    pictures[:, mask] = inferred, true
    similar = [ssim_in_the_box(*pictures, mask, span=each) for each in (span, 2)]
    return (square * inferred.shape[1]) ** 0.5, square**0.5, *similar


def test_truth_score_of_every_map_agrees_with_scikit_image(truth):
    one, mask, lights = truth
    maps = {name: noisy(one, name, 3) for name in ("albedo", "transport", "normal")}
    light = lights + RNG.normal(0, 0.1, lights.shape).astype(np.float32)
    inferred = Inferred(**maps, ao=noisy(one, "ao", 3)[..., 0], light=light, occlude=True)
    columns, signs = one.score(inferred), {"shading_contrast", "albedo_share"}
    wanted = {f"{quantity}_{reading}" for quantity in QUANTITIES for reading in FOUR} | signs
    assert set(columns) == wanted <= set(COLUMNS)
    lit, ao = inferred.transport * inferred.ao[..., None], inferred.ao[..., None]
    for n in range(3):
        true = {name: values[n if len(values) > 1 else 0] for name, values in one.maps.items()}
        shading = np.maximum(lit[n] @ inferred.light[n], 0)
        expected = {
            "albedo": (inferred.albedo[n], true["albedo"], 1),
            "transport": (inferred.transport[n], true["transport"], 2),
            "transport_with_ao": (lit[n], true["transport"], 2),
            "normal": (inferred.normal[n], true["normal"], 2),
            "ao": (ao[n], true["ao"], 1),
            "shading": (shading, np.maximum(true["transport"] @ lights[n], 0), 1),
            "shading_true_light": (np.maximum(lit[n] @ lights[n], 0), true["shading"], 1),
            "reconstruction": (inferred.albedo[n] * shading, true["albedo"] * true["shading"], 1),
        }
        after = (n + 1) % 3
        relit = inferred.albedo[n] * np.maximum(lit[n] @ lights[after], 0)
        expected["relit"] = relit, one.maps["reconstruction"][after], 1
        for quantity, (a, b, span) in expected.items():
            found = [columns[f"{quantity}_{reading}"][n] for reading in FOUR]
            np.testing.assert_allclose(found, readings(a, b, mask, span), rtol=2e-5, err_msg=quantity)


def test_light_errors_agree_with_scikit_image():
    true, inferred = RNG.normal(0, 0.4, (2, 4, 9, 3))
    columns = light_errors(inferred, true)
    for n in range(4):
        assert columns["light_rmse"][n] == pytest.approx(np.sqrt(((true[n] - inferred[n]) ** 2).mean()))
        expected = structural_similarity(inferred[n], true[n], win_size=3, data_range=2)
        assert columns["light_ssim"][n] == pytest.approx(expected)


def test_mask_box_of_a_thin_mask_has_a_window():
    pixel = np.array([5 * 16 + 7])  # one pixel: the box is widened to a window
    maps = {"transport": np.ones((1, 9)), "albedo": [[0.5] * 3], "normal": [[0.0, 0, 1]], "ao": np.ones((1, 1))}
    one = Truth(pixel, maps, np.zeros((1, 9, 3)), 16)
    assert one.box.shape == (7, 7)
    columns = one.score(Inferred(albedo=np.full((1, 1, 3), 0.5, np.float32)))
    assert columns["albedo_ssim"][0] == pytest.approx(1) and columns["albedo_rmse"][0] == 0


def test_compare_relit_takes_the_next_light(truth):
    """True maps relit are the truth; the picture as it is differs from it by albedo x the change of the shading."""
    one, _, _ = truth
    columns = one.score(Inferred(transport=one.transport))
    assert columns["relit_rmse"].max() < 1e-6 and columns["relit_ssim"].min() > 1 - 1e-6
    left = one.score(Inferred(relit=one.maps["reconstruction"]))
    assert set(left) == {f"relit_{reading}" for reading in FOUR}
    for n, after in enumerate((1, 2, 0)):
        change = one.maps["shading"][after] - one.maps["shading"][n]
        expected = np.sqrt(((one.maps["albedo"][0] * change) ** 2).sum(-1).mean())
        assert left["relit_rmse"][n] == pytest.approx(expected, rel=1e-5)


def test_contrast_and_explained_variance_of_a_collapse(truth):
    truth, _, _ = truth
    found = truth.score(Inferred(albedo=truth.maps["reconstruction"], transport=np.zeros_like(truth.transport)))
    uniform = truth.score(Inferred(albedo=np.ones_like(truth.maps["albedo"])))
    for columns, contrast, share in ((found, 0, 1), (uniform, 1, 0)):
        np.testing.assert_allclose(columns["shading_contrast"], contrast, atol=1e-6)
        np.testing.assert_allclose(columns["albedo_share"], share, atol=1e-6)
    assert (0 < truth.score(Inferred())["albedo_share"]).all()


def test_truth_score_of_networks_of_other_orders():
    """Cutting the true maps costs what the cut bands shade; transport and light are compared in nine coefficients."""
    rng, pixels = np.random.default_rng(0), 100
    transport, lights = rng.normal(0, 0.3, (pixels, 25)), rng.normal(0, 0.3, (2, 25, 3)).astype(np.float32)
    transport[:, 0], lights[:, 0] = 3, 3  # no shading is cut at zero
    mask = np.add.outer(np.arange(10) * 40, np.arange(10)).ravel()
    normal, white, ao = np.tile([0.0, 0, 1], (pixels, 1)), np.ones((pixels, 3)), np.ones((pixels, 1))
    truth = Truth(mask, {"transport": transport, "albedo": white, "normal": normal, "ao": ao}, lights, 40)
    for order in (2, 3, 4):
        count = (order + 1) ** 2
        maps = transport[None, :, :count].astype(np.float32)
        found = truth.score(Inferred(transport=maps, light=lights[:, :count]))
        lost = np.einsum("pk,lkc->lpc", transport[:, count:], lights[:, count:])
        np.testing.assert_allclose(found["shading_rmse"], np.sqrt((lost**2).sum(-1).mean(-1)), atol=1e-5)
        assert found["transport_rmse"].max() < 1e-6 and found["light_rmse"].max() < 1e-6
    assert truth.score(Inferred(transport=maps + 1))["transport_rmse"] == pytest.approx(3, rel=1e-5)  # nine ones
