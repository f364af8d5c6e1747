"""The roughness of cloth, measured on waves of known height."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

PATH = Path(__file__).parents[2] / "benchmarks" / "cloth.py"


@pytest.fixture(scope="module")
def cloth():
    spec = importlib.util.spec_from_file_location("cloth_benchmark", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("wave", [5.0, 9.0, 18.0, 40.0])
def test_a_wave_has_the_height_that_the_gaussians_leave_of_it(cloth, wave):
    """A Gaussian of sigma s leaves exp(-2 (pi s / wave)^2) of a sinusoid; its root mean square is a / sqrt 2."""
    y, x = np.mgrid[:400, :400]
    mask = np.hypot(x - 200, y - 200) < 180
    luminance = 0.3 * np.exp(0.2 * np.sin(2 * np.pi * (0.8 * x + 0.6 * y) / wave))
    luminance[~mask] = 1e-9  # not seen
    left = [[np.exp(-2 * (np.pi * s / wave) ** 2) for s in pair] for pair in cloth.SIGMAS]
    want = [0.2 / np.sqrt(2) * (small - large) for small, large in left]
    assert cloth.roughness(luminance, mask) == pytest.approx(want, rel=0.03, abs=5e-4)


def test_small_regions_are_not_measured(cloth):
    mask = np.zeros((60, 60), bool)
    mask[20:40, 20:40] = True
    fine, _, coarse = cloth.roughness(np.ones((60, 60)), mask)
    assert np.isnan(coarse) and np.isnan(fine)
    mask[5:55, 5:55] = True
    assert cloth.roughness(np.ones((60, 60)), mask) == pytest.approx([0, 0, 0], abs=1e-12)
