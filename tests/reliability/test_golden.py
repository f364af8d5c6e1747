"""Golden numbers, so that a change of results shows in review, and properties that hold whatever the input.

`RELIGHT_GOLDEN=write make test ARGS=tests/reliability/test_golden.py` writes golden.json anew. Numbers may
differ in the last digits between kinds of CPUs: TOLERANCE is far above that, and far below any change of a method.
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from people import person
from samples import mesh_of

from relight.figures.body.shape import build_body
from relight.figures.draw.person import sample_person
from relight.learning.networks import build
from relight.lights import load_light
from relight.meshes import Mesh, align
from relight.settings import Align, Model
from relight.transport import bake, bake_vertices

GOLDEN = Path(__file__).parent / "golden.json"
OPEN = np.sqrt(np.pi) / 2  # T00 of a point that nothing occludes
TOLERANCE = 1e-4  # relative; a tenth of it absolute


def body() -> list[float]:
    """The skin of a body: number of vertices, extents in metres, and its centre."""
    skin = build_body(sample_person(np.random.default_rng(1))).skin
    return [len(skin), *np.ptp(skin, axis=0), *skin.mean(axis=0)]


def maps() -> list[float]:
    """A person of capsules at 64 px: pixels, mean AO, mean transport."""
    solid = person(0)
    found = bake(align(mesh_of(solid.vertices, solid.faces), Align(up="+y", front="+z")), 64, 64)
    return [int(found.mask.sum()), found.ao[found.mask].mean(), *found.transport[found.mask].mean(axis=0)]


def light() -> list[float]:
    return list(load_light("room:7").coefficients[:4].ravel())


def network() -> list[float]:
    """What a fresh network of each kind makes of a fixed picture: the means of its outputs."""
    found = []
    image = torch.linspace(0, 1, 3 * 64 * 64).reshape(1, 3, 64, 64)
    for name, head in (("ours", "strided"), ("sfsnet_ao", "strided"), ("unet", "pooled")):
        torch.manual_seed(0)
        model = Model(name=name, width=0.125, norm="instance", dropout=0.0, order=2, albedo="clip", light_head=head,
                      refine=False, sees="image")  # fmt: skip
        with torch.no_grad():
            outputs = build(model, 64).eval()(image, torch.ones(1, 1, 64, 64))
        found += [outputs[key].abs().mean().item() for key in sorted(outputs)]
    return found


@pytest.mark.parametrize("what", [body, maps, light, network], ids=lambda what: what.__name__)
@pytest.mark.slow
def test_numbers_are_those_of_the_last_review(what):
    found = [float(f"{number:.7g}") for number in what()]
    golden = json.loads(GOLDEN.read_text()) if GOLDEN.exists() else {}
    if os.environ.get("RELIGHT_GOLDEN") == "write":
        GOLDEN.write_text(json.dumps({**golden, what.__name__: found}, indent=1, sort_keys=True) + "\n")
        return
    np.testing.assert_allclose(found, golden[what.__name__], rtol=TOLERANCE, atol=TOLERANCE / 10)


@st.composite
def soups(draw) -> Mesh:
    """A few triangles anywhere: open, crossing, of any orientation."""
    count = draw(st.integers(1, 12))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    corners = rng.uniform(-1, 1, (3 * count, 3)) * rng.uniform(0.01, 1, (3 * count, 1))
    return mesh_of(corners, np.arange(3 * count).reshape(-1, 3))


@given(soups())
@settings(max_examples=40, deadline=None)
def test_no_surface_receives_more_than_an_open_one(mesh):
    """T00 lies between 0 and that of an open point, so AO in [0,1]; no transport exceeds its coefficient's bound."""
    transport = bake_vertices(mesh, 64).transport
    assert np.isfinite(transport).all() and transport[:, 0].min() >= -1e-6 and transport[:, 0].max() <= OPEN + 1e-6
    # Cauchy-Schwarz over the hemisphere: |T_lm|^2 <= int cos^2 * int Y^2 <= (2 pi / 3) * 1
    assert np.abs(transport).max() <= np.sqrt(2 * np.pi / 3)
