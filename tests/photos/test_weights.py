from dataclasses import replace

import numpy as np
import pytest
import skimage.data
import skimage.io
from omegaconf import OmegaConf
from scipy.spatial import cKDTree

import relight
from relight.core import srgb
from relight.lights import load_light
from relight.meshes import align
from relight.photos.trust import ERROR
from relight.settings import composed
from relight.transport import bake
from relight.viewer.source import PORTRAIT_MASK


@pytest.fixture(scope="module")
def maps(figure):
    mesh = replace(figure, info=figure.info | {"axes": {"up": "+y", "front": "+z"}})
    return bake(align(mesh, OmegaConf.to_object(composed()).align), 128, 64)


@pytest.mark.slow
def test_shading_goes_with_the_truth(maps):
    relighter = relight.load()
    assert relighter.network.order == 4 and np.reshape(relighter.network.config["lights"], (-1, 25, 3)).size
    found = []
    for seed in (5003, 5004, 5005):
        truth = np.maximum(maps.transport @ load_light(f"room:{seed}").normalised(0.8).coefficients, 0)
        photo = srgb.to_bytes(srgb.encode(maps.albedo * truth))
        (person,) = relighter.infer(photo, maps.mask)
        assert np.abs(relighter.relight(photo, maps.mask, person.light).astype(int) - photo)[maps.mask].max() <= 1
        relit, shading = srgb.decode(photo / 255.0)[maps.mask].mean(-1), truth[maps.mask].mean(-1)
        place, own = (
            np.stack([np.interp(v, (v.min(), v.max()), (0, 1)) for v in np.nonzero(mask)], -1)
            for mask in (person.mask, maps.mask)
        )
        inferred = person.shading[person.mask > 0].mean(-1)[cKDTree(place).query(own)[1]]
        found.append((np.corrcoef(inferred, shading)[0, 1], np.corrcoef(relit, shading)[0, 1]))
    ours, brightness = np.mean(found, 0)
    assert ours > 0.6 and ours > brightness, found  # better than taking a bright pixel for a lit one


@pytest.mark.slow
def test_a_photograph_of_a_real_person():
    """Orange is the suit's and not the light's, and a lamp brightens the side on which it stands."""
    photo = skimage.data.astronaut()
    mask = skimage.io.imread(PORTRAIT_MASK) / 255
    relighter = relight.load()
    (person,) = relighter.infer(photo, mask)
    assert person.error < ERROR
    suit = (person.mask > 0) & (person.albedo[..., 0] > 0.4) & (person.albedo[..., 2] < 0.5 * person.albedo[..., 0])
    assert suit.sum() > 0.2 * person.mask.sum()
    red, _, blue = person.shading[suit].mean(0)
    assert 0.7 < red / blue < 1.8
    lit = [relighter.relight(photo, mask, f"key:#ffffff@{side},10,0.1") for side in (-80, 80)]
    cheeks = [[srgb.decode(one[110:150, x : x + 20] / 255.0).mean() for x in (185, 240)] for one in lit]
    assert cheeks[0][0] > 1.5 * cheeks[0][1] and cheeks[1][1] > 1.2 * cheeks[1][0]
    for one in lit:
        np.testing.assert_array_equal(one[person.coverage == 0], photo[person.coverage == 0])
