"""Light stages: quadrature by lamps, and measurements from frames, against closed forms."""

import numpy as np
import pytest
from capture_twin import MIDDLE, STAGE, lamps

from relight.captures.lightstage import MAX_DEGREE, LightStage, projection_error, quadrature_weights
from relight.captures.measure import measure
from relight.errors import UserError
from relight.sh import basis, unoccluded
from relight.srgb import encode, to_bytes

ROUNDING = 6e-4  # error of transport by the rounding of frames to 8 bits


def around(count: int = 331) -> np.ndarray:
    return (lamps(count) - MIDDLE) / STAGE


def test_quadrature_weights_integrate_what_a_stage_needs():
    """Exact for harmonics; unoccluded transport far better than cells where lamps are missing."""
    whole = around()
    holes = whole[np.random.default_rng(0).random(331) > 0.1]
    for directions, highest in ((whole, 0.0015), (holes, 0.004)):
        weights = quadrature_weights(directions)
        assert weights.min() > 0 and np.isclose(weights.sum(), 4 * np.pi)
        moments = weights @ basis(directions, MAX_DEGREE)
        assert np.isclose(moments[0], np.sqrt(4 * np.pi)) and np.abs(moments[1:]).max() < 1e-9
        assert projection_error(directions, weights) < highest
    equal = np.full(len(holes), 4 * np.pi / len(holes))
    assert projection_error(holes, quadrature_weights(holes)) < 0.2 * projection_error(holes, equal)
    floorless = whole[whole[:, 1] > -0.8]  # a cap of 37 degrees has no lamps: fewer degrees, but no negative weights
    assert quadrature_weights(floorless).min() > 0
    with pytest.raises(UserError, match="directions do not span a sphere"):
        quadrature_weights(np.array([[1.0, 0, 0]] * 9))


def test_projection_error_by_sampling():
    """`projection_error` against random normals."""
    directions, rng = around(97), np.random.default_rng(2)
    weights = quadrature_weights(directions)
    normals = rng.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = np.maximum(normals @ directions.T, 0) * weights @ basis(directions)
    true = np.sqrt(((found - unoccluded(normals)) ** 2).sum(1).mean())
    assert np.isclose(projection_error(directions, weights), true, rtol=0.05)


def ball(stage: LightStage, offset: np.ndarray, count: int = 400) -> dict:
    """Points on a small matt ball at an offset from the centre, and the frames of all lamps, exact but for 8 bits."""
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = stage.centre + offset + 50 * normals
    albedo = rng.uniform(0.1, 0.9, (count, 3))

    def frames():
        for lamp, position in enumerate(stage.positions):
            toward = position - points
            distance = np.linalg.norm(toward, axis=1)
            cosine = np.maximum((normals * toward).sum(1) / distance, 0)
            code = encode(0.5 * albedo * (cosine * (stage.radius / distance) ** 2)[:, None])
            yield lamp, to_bytes(code)

    return {"points": points, "normals": normals, "albedo": albedo, "frames": frames}


@pytest.mark.parametrize("offset", [(0, 0, 0), (100, -800, 50)])
def test_measure_of_a_ball(offset):
    """Nothing occludes it. Off the centre, lamps are 1.7 to 3.3 m away: falling off and directions must be undone."""
    stage = LightStage.from_positions(lamps())
    assert np.allclose(stage.centre, MIDDLE) and np.isclose(stage.radius, STAGE)
    scene = ball(stage, np.array(offset, float))
    found = measure(scene["frames"], stage, scene["points"])
    assert found.known.all() and found.clipped == 0
    assert np.allclose(found.albedo, 0.5 * scene["albedo"], rtol=0.004)
    assert (found.normal * scene["normals"]).sum(1).min() > np.cos(np.radians(0.3))
    error = np.sqrt(((found.transport - unoccluded(scene["normals"])) ** 2).sum(1).mean())
    assert error < (1 if offset == (0, 0, 0) else 3) * stage.error + ROUNDING
    assert stage.error < 0.0013


def test_measure_pictures_under_a_panorama():
    """A panorama of nine coefficients: albedo times irradiance has a closed form; the factor is the lamps'."""
    stage = LightStage.from_positions(lamps())
    scene = ball(stage, np.zeros(3))
    coefficients = np.concatenate([np.full((1, 3), 1.2), np.random.default_rng(1).uniform(-0.25, 0.25, (8, 3))])

    def radiance(directions):
        first = basis(directions) @ coefficients
        return np.stack([first, np.ones_like(first)], 1)

    found = measure(scene["frames"], stage, scene["points"], radiance)
    expected = scene["albedo"] * (unoccluded(scene["normals"]) @ coefficients)
    assert np.abs(found.pictures[:, 0] / 0.5 - expected).max() < 0.02
    assert np.allclose(found.pictures[:, 1] / 0.5, np.pi * scene["albedo"], rtol=0.01)


def test_measure_of_pixels_lit_by_too_few_lamps():
    """A pixel that three lamps light has no normal, and its maps are zero."""
    stage = LightStage.from_positions(lamps())
    scene = ball(stage, np.zeros(3), 2)

    def frames():
        for lamp, codes in scene["frames"]():
            yield lamp, codes * np.array([[1], [lamp < 3]], np.uint8)

    found = measure(frames, stage, scene["points"])
    assert found.known.tolist() == [True, False]
    assert not found.albedo[1].any() and not found.transport[1].any()
