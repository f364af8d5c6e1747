"""Cloth by extended position-based dynamics (XPBD) in Warp: stretch, bending, contact with layers below, friction.

Macklin, Mueller, Chentanez, "XPBD: position-based simulation of compliant constrained dynamics", 2016; here with the
rigid limit and relaxation factors, which is what cloth at 6 mm to 25 mm edges needs. Constraints are solved one after
the other in a fixed order (Gauss-Seidel), so the result is the same to the last bit in every process.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count, pairwise

import numpy as np
import scipy.sparse as sparse
import warp as wp

from relight.figures.colliders import Collider, vectors
from relight.figures.kernels import (
    find_below,
    find_close,
    hold_lengths,
    pin,
    predict,
    push_apart,
    push_out,
    update_velocity,
)
from relight.figures.surfaces import edges, neighbours

GRAVITY = -9.8
NEIGHBOURS = 8  # self-contact: as many close vertices as one vertex looks at
EDGE = 0.025  # metres: the edges at which `Cloth.bend` is given
FAR = 0.15  # metres within which a layer below is looked for


@dataclass(frozen=True)
class Crimp:
    """How a cloth folds more finely than it is draped. width: metres from crest to crest of its finest folds; slack:
    how much longer it is than its pattern, for these folds; often: crests for the room there is; length: metres of a
    usual crest."""

    width: float = 0.026
    slack: float = 0.06
    often: float = 2.0
    length: float = 0.07


@dataclass(frozen=True)
class Cloth:
    """What the fabric is like. bend: 0 silk to 0.6 leather, at edges of 25 mm; crumple: how much longer the cloth is
    than its pattern; thickness: metres between the layers; friction in [0,1]; crimp: its fine folds."""

    bend: float = 0.15
    crumple: float = 0.02
    thickness: float = 0.004
    friction: float = 0.25
    crimp: Crimp = Crimp()


@dataclass(frozen=True)
class Effort:
    """How a level of detail is simulated: substeps per frame, iterations per substep, frames of rest, self-contact."""

    substeps: int
    iterations: int
    settle: int
    gravity: float = GRAVITY
    contact: bool = True


def coloured(pairs: np.ndarray) -> np.ndarray:
    """Colours (m,) of pairs (m,2) such that pairs of one colour share no vertex: greedy, in the order given."""
    taken: list[set[int]] = [set() for _ in range(int(pairs.max()) + 1)]
    color = np.empty(len(pairs), int)
    for k, (i, j) in enumerate(pairs.tolist()):
        used = taken[i] | taken[j]
        color[k] = next(c for c in count() if c not in used)
        taken[i].add(color[k])
        taken[j].add(color[k])
    return color


class Sheet:
    """One garment at one level of detail. pattern (n,3): its shape defines the lengths at rest; parallel: whether pairs
    are solved many at a time, as a GPU needs it; by default as the device is."""

    def __init__(self, pattern: np.ndarray, faces: np.ndarray, cloth: Cloth, parallel: bool | None = None):
        parallel = wp.get_device().is_cuda if parallel is None else parallel
        self.cloth, self.n, self.faces = cloth, len(pattern), faces
        stretch, face_edge, uses = edges(faces)
        across = np.full((len(stretch), 2), -1)
        for side, opposite in ((0, 2), (1, 0), (2, 1)):
            edge = face_edge[:, side]
            first = across[edge, 0] < 0
            first[np.setdiff1d(np.arange(len(edge)), np.unique(edge, return_index=True)[1])] = False
            across[edge[first], 0] = faces[first, opposite]
            across[edge[~first], 1] = faces[~first, opposite]
        bend = across[(uses == 2) & (across >= 0).all(1)]
        pairs = np.concatenate([bend, stretch])
        length = np.linalg.norm(pattern[pairs[:, 0]] - pattern[pairs[:, 1]], axis=1)
        softer = min(1.0, length[len(bend) :].mean() / EDGE) ** 1.5  # else finer cloth would be stiffer cloth
        gain = np.r_[np.full(len(bend), cloth.bend * softer), np.ones(len(stretch))]
        self.edge, self.edge_rest = stretch, length[len(bend) :]
        self.mean = float(self.edge_rest.mean())
        self.bounds = [0, len(pairs)]
        if parallel:
            color = coloured(pairs)
            order = np.argsort(color, kind="stable")
            pairs, gain, length = pairs[order], gain[order], length[order]
            self.bounds = [0, *np.cumsum(np.bincount(color)).tolist()]
        self.pair: wp.array = wp.array(pairs.astype(np.int32), dtype=wp.vec2i)
        self.rest: wp.array = wp.array((length * (1 + cloth.crumple)).astype(np.float32), dtype=float)
        self.gain: wp.array = wp.array(gain.astype(np.float32), dtype=float)
        self.pattern = vectors(pattern)
        self.x, self.p, self.y, self.v = vectors(pattern), vectors(pattern), vectors(pattern), vectors(pattern * 0)
        self.face = wp.zeros(self.n, dtype=int)
        self.at = wp.zeros(self.n, dtype=wp.vec2)
        self.close = wp.full(self.n * NEIGHBOURS, -1, dtype=int)
        self.grid = wp.HashGrid(64, 64, 64)

    def move_to(self, positions: np.ndarray) -> None:
        """Puts the vertices at positions (n,3), at rest."""
        self.x = vectors(positions)
        self.v.zero_()

    def positions(self) -> np.ndarray:
        """Where the vertices are, (n,3) metres."""
        return self.x.numpy().astype(float)

    def strain(self) -> np.ndarray:
        """Length of each edge over its length on the pattern."""
        x = self.positions()
        return np.linalg.norm(x[self.edge[:, 0]] - x[self.edge[:, 1]], axis=1) / self.edge_rest

    def hold_lengths(self, times: int) -> None:
        """All pairs in their order; or colour by colour, where no two pairs of a colour share a vertex."""
        constraint = [self.x, self.pair, self.rest, self.gain]
        if len(self.bounds) == 2:
            wp.launch(hold_lengths, dim=1, inputs=[*constraint, 0, self.bounds[1], 1, times])
            return
        for _ in range(times):
            for first, last in pairwise(self.bounds):
                wp.launch(hold_lengths, dim=last - first, inputs=[*constraint, first, last, last - first, 1])

    def frame(self, below: Collider, effort: Effort, ground: float, damp: float) -> None:
        """Advances a sixtieth of a second."""
        dt, cloth = 1 / 60 / effort.substeps, self.cloth

        def launch(kernel: wp.Kernel, *inputs: object, dim: int = self.n) -> None:
            wp.launch(kernel, dim=dim, inputs=list(inputs))

        launch(find_below, below.mesh.id, self.x, FAR, self.face, self.at)
        if effort.contact:
            self.grid.build(self.x, self.mean)
            launch(find_close, self.grid.id, self.x, self.pattern, self.mean, self.close, NEIGHBOURS)
        contact = [self.face, self.at, below.corner, below.before, below.after, below.normal]
        for k in range(effort.substeps):
            launch(predict, self.x, self.v, self.p, effort.gravity, dt, damp)
            self.hold_lengths(effort.iterations)
            if effort.contact:
                launch(push_apart, self.x, self.y, self.close, NEIGHBOURS, 0.9 * self.mean)
                self.x, self.y = self.y, self.x
            span = [k / effort.substeps, (k + 1) / effort.substeps]
            launch(push_out, self.x, self.p, *contact, *span, cloth.thickness, cloth.friction, ground)
            launch(update_velocity, self.x, self.p, self.v, dt, 3.0)

    def hold(self, held: np.ndarray, gain: np.ndarray, goal: np.ndarray, below: Collider, ground: float) -> None:
        """Pulls the vertices `held` (m,) to their goals (m,3) with gains (m,) in [0,1], then all out of the layers.

        Those held fully end exactly at their goals: folds below must not drag a waistband down.
        """
        index: wp.array = wp.array(held.astype(np.int32), dtype=int)
        pull: wp.array = wp.array(gain.astype(np.float32), dtype=float)
        keep: wp.array = wp.array((gain > 0.99).astype(np.float32), dtype=float)
        to = vectors(goal)
        wp.launch(pin, dim=len(held), inputs=[self.x, index, pull, to])
        contact = [self.face, self.at, below.corner, below.before, below.after, below.normal]
        wp.launch(
            push_out,
            dim=self.n,
            inputs=[self.x, self.x, *contact, 1.0, 1.0, self.cloth.thickness, 0.0, ground],
        )
        wp.launch(pin, dim=len(held), inputs=[self.x, index, keep, to])


@dataclass(frozen=True)
class Level:
    """pattern (n,3): lengths at rest; start, held (n,3): where it begins, where pins hold it, on the rest pose; pinned
    (n,) in [0,1]; weights (n,B) of the skinning that moves the pins."""

    pattern: np.ndarray
    start: np.ndarray
    held: np.ndarray
    pinned: np.ndarray
    weights: np.ndarray
    faces: np.ndarray

    def mapped(self, matrix: sparse.csr_matrix, faces: np.ndarray) -> "Level":
        """The level with other faces, whose vertices (m) are mixed from these by a matrix (m,n)."""
        start, held, pinned = matrix @ self.start, matrix @ self.held, matrix @ self.pinned
        return Level(matrix @ self.pattern, start, held, pinned, matrix @ self.weights, faces)


@dataclass(frozen=True)
class Draped:
    """positions (n,3) at the finest level, history: level-0 positions at each frame, strain of the finest edges."""

    positions: np.ndarray
    history: list[np.ndarray]
    strain: np.ndarray


def mended(x: np.ndarray, faces: np.ndarray, edge: np.ndarray, strain: np.ndarray, firm: np.ndarray) -> np.ndarray:
    """Spreads single over-stretched edges, where a pin and a contact disagreed, over their neighbourhood; vertices in
    the mask `firm` (n,) stay."""
    torn = np.zeros(len(x))
    torn[edge[strain > 1.5].ravel()] = 1
    near = neighbours(faces, len(x))
    for _ in range(2):
        torn = np.maximum(torn, np.minimum(1, near @ torn * 2))
    torn[firm] = 0
    for _ in range(8):
        x = x + (0.6 * torn)[:, None] * (near @ x - x)
    return x


def drape(
    levels: list[Level],
    refine: list[sparse.csr_matrix],
    cloth: Cloth,
    efforts: list[Effort],
    below: Callable[[int, bool], tuple[np.ndarray, np.ndarray]],
    skin: Callable[[np.ndarray, np.ndarray, int], np.ndarray],
    frames: int,
    ground: float,
) -> Draped:
    """Drapes from coarse to fine: the coarsest level follows the body's motion, the finer ones settle at its end.

    below(frame, fine) gives the surface under the garment; skin(weights, rest, frame) moves the pins; refine[k] is the
    matrix from level k to k+1.
    """
    history: list[np.ndarray] = []
    x = skin(levels[0].weights, levels[0].start, 0)
    for number, (level, effort) in enumerate(zip(levels, efforts)):
        sheet = Sheet(level.pattern, level.faces, cloth)
        sheet.move_to(x)
        held = np.flatnonzero(level.pinned > 0.01)
        moving = list(range(1, frames + 1)) if number == 0 else []
        if number == 0:
            history.append(sheet.positions())
        fine = number > 0
        surface: Collider | None = None
        for step, now in enumerate(moving + [frames] * effort.settle):
            if surface is None or step <= len(moving):
                last = now - 1 if step < len(moving) else now
                before, faces = below(last, fine)
                surface = Collider(before, below(now, fine)[0] if last != now else before, faces)
            sheet.frame(surface, effort, ground, damp=0.99 if step < len(moving) else 0.9)
            if len(held):
                goal = skin(level.weights[held], level.held[held], now)
                sheet.hold(held, level.pinned[held], goal, surface, ground)
            if number == 0 and step < len(moving):
                history.append(sheet.positions())
        x = sheet.positions()
        if number == len(levels) - 1:
            x = mended(x, level.faces, sheet.edge, sheet.strain(), level.pinned > 0.99)
            sheet.move_to(x)
        strain = sheet.strain()
        if number == 0:
            history[-1] = x
        if number < len(levels) - 1:
            x = refine[number] @ x
    return Draped(x, history, strain)
