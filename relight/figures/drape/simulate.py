"""Drapes a garment from coarse to fine while the body moves into its pose."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from relight.figures.cut.patterns import Pattern
from relight.figures.drape.colliders import Collider
from relight.figures.drape.solver import ClothSolver, SolverSettings
from relight.figures.surfaces import Surface, neighbours

GROUND = 0.006  # lowest height of cloth, metres
TORN = 1.5  # strain above which an edge is relaxed at the end
MOVING_DAMPING, SETTLING_DAMPING = 0.99, 0.9  # factor of the velocities at each substep
SurfaceBelow = Callable[[int, bool], Surface]
Skinning = Callable[[np.ndarray, np.ndarray, int], np.ndarray]


@dataclass(frozen=True)
class DrapeResult:
    """A garment after the simulation.

    Attributes:
        positions: (n,3) vertices of the finest level, metres.
        history: (m,3) vertices of the coarsest level at each frame.
        strain: (E,) length of the finest level's edges over that on the pattern.
    """

    positions: np.ndarray
    history: list[np.ndarray]
    strain: np.ndarray


def relax_torn_edges(
    x: np.ndarray, faces: np.ndarray, edge: np.ndarray, strain: np.ndarray, fixed: np.ndarray
) -> np.ndarray:
    """Smooths cloth around edges with a strain above TORN, where a pin and a contact disagreed.

    Args:
        x: (n,3) vertices, metres.
        faces: (F,3).
        edge: (E,2).
        strain: (E,) length of the edges over that on the pattern.
        fixed: (n,) vertices that stay.

    Returns:
        (n,3) vertices, metres.
    """
    amount = np.zeros(len(x))  # of smoothing
    amount[edge[strain > TORN].ravel()] = 1
    average = neighbours(faces, len(x))
    for _ in range(2):  # spreads to the neighbours
        amount = np.maximum(amount, np.minimum(1, average @ amount * 2))
    amount[fixed] = 0
    for _ in range(8):
        x = x + (0.6 * amount)[:, None] * (average @ x - x)
    return x


def drape(
    pattern: Pattern, settings: list[SolverSettings], surface_at: SurfaceBelow, skin: Skinning, frames: int
) -> DrapeResult:
    """Drapes a garment from coarse to fine: its coarsest level follows the motion, the others settle at the end.

    Args:
        pattern: the garment.
        settings: the solver's, for each level.
        surface_at: (frame, fine) to the vertices and faces of the surface below the garment; `fine` for all levels but
            the coarsest.
        skin: (weights (n,B), rest positions (n,3), frame) to posed positions (n,3); moves the pins.
        frames: the last frame of the motion; 0 if the body does not move.

    Returns:
        The garment at the last frame, settled.
    """
    history: list[np.ndarray] = []
    levels = pattern.levels
    x = skin(levels[0].weights, levels[0].start, 0)
    for number, (level, solver_settings) in enumerate(zip(levels, settings)):
        coarsest, finest = number == 0, number == len(levels) - 1
        solver = ClothSolver(level.rest_shape, level.faces, pattern.garment.cloth)
        solver.move_to(x)
        pinned = np.flatnonzero(level.pin_weight > 0.01)
        moving_frames = list(range(1, frames + 1)) if coarsest else []
        if coarsest:
            history.append(solver.positions())
        for step, frame in enumerate(moving_frames + [frames] * solver_settings.settle_frames):
            moving = step < len(moving_frames)
            if step <= len(moving_frames):  # at rest, one collider serves all frames
                previous = frame - 1 if moving else frame
                start, faces = surface_at(previous, not coarsest)
                end = surface_at(frame, not coarsest)[0] if moving else start
                collider = Collider(start, end, faces)
            solver.step_frame(collider, solver_settings, GROUND, damping=MOVING_DAMPING if moving else SETTLING_DAMPING)
            if len(pinned):
                target = skin(level.weights[pinned], level.fitted[pinned], frame)
                solver.pin(pinned, level.pin_weight[pinned], target, collider, GROUND)
            if moving:
                history.append(solver.positions())
        x = solver.positions()
        if finest:
            x = relax_torn_edges(x, level.faces, solver.edges, solver.strain(), fixed=level.pin_weight > 0.99)
            solver.move_to(x)
        strain = solver.strain()
        if coarsest:
            history[-1] = x  # the last frame is the one that has settled
        if not finest:
            x = pattern.refine[number] @ x
    return DrapeResult(x, history, strain)
