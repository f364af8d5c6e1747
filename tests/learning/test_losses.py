"""The losses against formulas written out on whole images, and their gradients."""

import itertools
from dataclasses import fields

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from scipy.ndimage import binary_erosion

from relight.core.errors import UserError
from relight.learning.data import RelitSet
from relight.learning.losses import DARK, LEVEL, OCTAVES, TERMS, losses
from relight.settings import CONF, Loss, composed
from relight.settings.schema import FIELDS
from relight.settings.setting import setting_of
from relight.sh import unoccluded

FIFTEEN = {"albedo", "transport", "light", "tv_albedo", "tv_transport"}
FIFTEEN |= {f"shading_{own}" for own in ("transport", "light", "transport_light")}
OWN = "albedo transport light albedo_transport albedo_light transport_light full"
FIFTEEN |= {f"reconstruction_{own}" for own in OWN.split()}
RELIT = {"relit_shading", "relit_image"}
DETAILS = {"detail_albedo", "detail_transport", "detail_shading", "exclusion"}
BEYOND_THE_PAPER = dict.fromkeys(("detail", "exclusion", "relit"), 1.0)  # settings


def batch_of(world, color="paper"):
    data = RelitSet(world["packed"], world["lights"], 2, color)
    data.lights[:, 9:] = 0  # the paper's world has nine coefficients
    return data.batch(np.array([3, 0]), np.array([1, 5]))


def inferred(batch, name: str = "ours") -> dict[str, torch.Tensor]:
    """Network outputs far from the truth, whose shadings are cut at both ends; float64."""
    generator = torch.Generator().manual_seed(0)

    def noise(channels: int) -> torch.Tensor:
        return torch.randn(2, channels, batch.size, batch.size, generator=generator, dtype=torch.float64)

    outputs = {"albedo": noise(3).sigmoid(), "light": batch.light.double() + 0.5 * noise(27)[:, :, 0, 0].view(2, 9, 3)}
    if name == "ours":
        return outputs | {"transport": 4 * noise(9)}
    outputs["normal"] = torch.nn.functional.normalize(noise(3), dim=1)
    return outputs | ({"ao": noise(1)} if name == "sfsnet_ao" else {})


def by_hand(outputs: dict, batch, reduction: str) -> dict[str, float]:
    """All losses on whole images: paper sections 3 and 4, and detail."""

    def image(tensor: torch.Tensor) -> np.ndarray:
        return tensor.double().permute(0, 2, 3, 1).numpy()

    mask = image(batch.mask)[..., 0] > 0
    pixels = mask.size if reduction == "image" else mask.sum()

    def mean(error: np.ndarray, where=mask) -> float:
        return np.abs(error)[where].sum() / (pixels * error.shape[-1])

    true = {key: image(batch.scatter(getattr(batch, key))) for key in ("albedo", "transport", "normal", "ao")}
    own = {key: image(value) for key, value in outputs.items() if key != "light"}
    if "transport" not in own:
        own["transport"] = unoccluded(own["normal"], 2) * own.get("ao", np.ones(1))
    maps = {"true": true, "own": own}
    light = {"true": batch.light.double().numpy(), "own": outputs["light"].numpy()}
    light["other"] = light["true"][::-1]  # of the other of two images
    pairs = [*itertools.product(maps, light)]
    shading = {(t, l): np.einsum("bijk,bkc->bijc", maps[t]["transport"], light[l]).clip(0, 10) for t, l in pairs}
    means = {key: mean(value - true[key]) for key, value in own.items()}
    inner = binary_erosion(mask, [[[0, 1, 0], [1, 1, 1], [0, 1, 0]]])  # with all four neighbours
    for key in ("albedo", "transport"):
        means[f"tv_{key}"] = sum(mean(np.roll(own[key], -1, axis) - own[key], inner) for axis in (1, 2))
    for name, t, l in (("transport", "own", "true"), ("light", "true", "own"), ("transport_light", "own", "own")):
        means[f"shading_{name}"] = mean(shading[t, l] - shading["true", "true"])
    means["relit_shading"] = mean(shading["own", "other"] - shading["true", "other"])
    relit = [maps[which]["albedo"] * shading[which, "other"] for which in maps]
    means["relit_image"] = mean(relit[1] - relit[0])
    for a, t, l in itertools.product(maps, repeat=3):
        parts = [part for part, kind in (("albedo", a), ("transport", t), ("light", l)) if kind == "own"]
        error = maps[a]["albedo"] * shading[t, l] - true["albedo"] * shading["true", "true"]
        means["reconstruction_" + ("full" if len(parts) == 3 else "_".join(parts))] = mean(error)
    for which, values in maps.items():
        values["shading"] = shading[which, "true"]
    means |= {key: detail_by_hand(own[key[7:]], true[key[7:]], mask) for key in DETAILS - {"exclusion"}}
    means["exclusion"] = exclusion_by_hand(own, true, mask)
    return means | {"light": np.abs(light["own"] - light["true"]).mean()}


def detail_of(values: np.ndarray, inside: np.ndarray, k: int) -> np.ndarray:
    """What the mean of a square of 2^k pixels has beyond that of 2^(k+1), for each pixel inside by itself."""
    found = []
    for i, j in zip(*np.nonzero(inside)):
        means = []
        for side in (2**k, 2 ** (k + 1)):
            part = tuple(slice(at // side * side, at // side * side + side) for at in (i, j))
            means.append(values[part][inside[part]].mean(0))
        found.append(means[0] - means[1])
    return np.array(found)


def octaves_of(mask: np.ndarray) -> itertools.product:
    return itertools.product(range(min(OCTAVES, int(np.log2(mask.shape[1])))), range(len(mask)))


def detail_by_hand(own: np.ndarray, true: np.ndarray, mask: np.ndarray) -> float:
    ratios = []
    for k, b in octaves_of(mask):
        level = LEVEL**2 * (true[b][mask[b]] ** 2).sum()
        wrong = (detail_of(own[b] - true[b], mask[b], k) ** 2).sum()
        ratios.append(wrong / ((detail_of(true[b], mask[b], k) ** 2).sum() + level))
    return float(np.mean(ratios))


def exclusion_by_hand(own: dict, true: dict, mask: np.ndarray) -> float:
    excess = []
    for k, b in octaves_of(mask):
        pairs = ([maps[key][b].mean(-1).clip(DARK) for key in ("albedo", "shading")] for maps in (own, true))
        found, exact = ([detail_of(np.log(values), mask[b], k) for values in pair] for pair in pairs)
        energy = np.prod([(a**2).sum() + LEVEL**2 * (t**2).sum() for a, t in zip(found, exact)])
        floor = np.abs(np.prod(exact, 0)).sum() / max(np.prod([(t**2).sum() for t in exact]), 1e-12) ** 0.5
        excess.append(max(np.abs(np.prod(found, 0)).sum() / energy**0.5 - floor, 0))
    return float(np.mean(excess))


@pytest.mark.parametrize("name", ["ours", "sfsnet", "sfsnet_ao"])
@pytest.mark.parametrize("reduction", ["image", "mask"])
def test_against_the_formulas(tiny_world, loss, name, reduction):
    batch = batch_of(tiny_world)
    outputs = inferred(batch, name)
    _, found = losses(outputs, batch, loss(reduction=reduction, **BEYOND_THE_PAPER))
    expected = by_hand(outputs, batch, reduction)
    own = {"ours": {"transport"}, "sfsnet": {"normal"}, "sfsnet_ao": {"normal", "ao"}}[name]
    assert set(found) == FIFTEEN - {"transport"} | RELIT | DETAILS | own
    for key, value in found.items():
        assert value.item() == pytest.approx(expected[key], rel=1e-6, abs=1e-6), key


def parts_of(name: str) -> set[str]:
    """The outputs that a loss must teach: those in its name, all of them for `full`."""
    if name in ("detail_shading", "relit_shading"):  # under true lights
        return {"transport"}
    if name in ("relit_image", "exclusion"):
        return {"albedo", "transport"}
    return {"albedo", "transport", "light"} & set(name.split("_")) or {"albedo", "transport", "light"}


@pytest.mark.parametrize("name", sorted(FIFTEEN | RELIT | DETAILS))
def test_each_loss_teaches_what_its_name_says_and_nothing_else(tiny_world, loss, name):
    batch = batch_of(tiny_world)
    outputs = {key: value.float() for key, value in inferred(batch).items()}
    outputs["transport"] = batch.scatter(batch.transport) + 0.1 * outputs["transport"]
    leaves = {key: value.requires_grad_() for key, value in outputs.items()}
    losses(leaves, batch, loss(**BEYOND_THE_PAPER))[1][name].backward()
    assert {key for key, leaf in leaves.items() if leaf.grad is not None and leaf.grad.any()} == parts_of(name)


@pytest.mark.slow
def test_presets_hold_the_losses_of_the_tables(tiny_world):
    batch = batch_of(tiny_world)
    expected = {
        "full": FIFTEEN,
        "min": {"albedo", "transport", "light", "reconstruction_full"},
        "plus": FIFTEEN | RELIT,
        "photo": FIFTEEN - {"tv_albedo", "tv_transport"} | RELIT | DETAILS,
        "self_supervised": {"reconstruction_full"},
        "transport": {"transport", "tv_transport"},
        "no_tv": FIFTEEN - {"tv_albedo", "tv_transport"},
        "no_shading": {name for name in FIFTEEN if not name.startswith("shading")},
        "no_reconstruction": {n for n in FIFTEEN if not n.startswith("reconstruction") or n == "reconstruction_full"},
    }
    assert {path.stem for path in (CONF / "loss").glob("*.yaml")} == set(expected)
    for preset, names in expected.items():
        settings = OmegaConf.to_object(composed([f"loss={preset}"])).loss
        assert set(losses(inferred(batch), batch, settings)[1]) == names, preset


@pytest.mark.parametrize("name", TERMS)
def test_each_weight_has_a_term_and_says_what_its_losses_teach(tiny_world, name):
    assert {item.name for item in fields(Loss) if item.type is float} == set(TERMS)
    batch = batch_of(tiny_world)
    of_weight = losses(inferred(batch), batch, Loss(**{name: 1.0}))[1]
    assert set().union(*map(parts_of, of_weight)) == set(setting_of(FIELDS[f"loss.{name}"]).teaches)


@pytest.mark.parametrize("value", [torch.ones(2), 1.0])
def test_a_loss_of_an_extension_must_be_a_scalar(tiny_world, monkeypatch, value):
    monkeypatch.setattr("relight.learning.losses.extension", lambda name, part: lambda outputs, batch: value)
    with pytest.raises(UserError, match="the loss of the extension mine must be a tensor of one number"):
        losses(inferred(batch := batch_of(tiny_world)), batch, Loss(extra={"mine": 1.0}))
