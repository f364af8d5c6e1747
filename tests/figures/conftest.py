"""Warp, which many parts of figures need, and a body."""

import numpy as np
import pytest

from relight.figures.body.person import build_body, sample_person
from relight.figures.cloth import colliders


@pytest.fixture(scope="session", autouse=True)
def warp():
    colliders.init_warp()


@pytest.fixture(scope="session")
def body():
    return build_body(sample_person(np.random.default_rng(3)))
