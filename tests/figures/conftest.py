"""Warp, which many parts of figures need, and a body."""

import numpy as np
import pytest

from relight.figures.body.shape import build_body
from relight.figures.drape import colliders
from relight.figures.draw.person import sample_person


@pytest.fixture(scope="session", autouse=True)
def warp():
    colliders.init_warp()


@pytest.fixture(scope="session")
def body():
    return build_body(sample_person(np.random.default_rng(3)))
