"""Cloth by extended position-based dynamics (XPBD) in Warp: stretch, bending, contact with layers below, friction.

Macklin, Mueller, Chentanez, "XPBD: position-based simulation of compliant constrained dynamics", 2016; here with the
rigid limit and relaxation factors, which is what cloth at 6 mm to 25 mm edges needs. Constraints are solved one after
the other in a fixed order (Gauss-Seidel), so the result is the same to the last bit in every process.
"""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import warp as wp
from platformdirs import user_cache_path

from relight.figures.surfaces import edges, neighbours, normals

wp.config.log_level = wp.LOG_ERROR
GRAVITY = -9.8
NEIGHBOURS = 8  # self-contact: as many close vertices as one vertex looks at
FAR = 0.15  # metres within which a layer below is looked for


@dataclass(frozen=True)
class Cloth:
    """What the fabric is like. bend: 0 silk to 0.6 leather; crumple: how much longer the cloth is than its pattern;
    thickness: metres between the layers; friction in [0,1]."""

    bend: float = 0.15
    crumple: float = 0.02
    thickness: float = 0.004
    friction: float = 0.25


@dataclass(frozen=True)
class Effort:
    """How a level of detail is simulated: substeps per frame, iterations per substep, frames of rest, self-contact."""

    substeps: int
    iterations: int
    settle: int
    gravity: float = GRAVITY
    contact: bool = True


@wp.kernel
def predict(
    x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), p: wp.array(dtype=wp.vec3), g: float, dt: float, damp: float
):
    i = wp.tid()
    p[i] = x[i]
    x[i] = x[i] + v[i] * (dt * damp) + wp.vec3(0.0, g * dt * dt, 0.0)


@wp.kernel
def hold_lengths(
    x: wp.array(dtype=wp.vec3),
    pair: wp.array(dtype=wp.vec2i),
    rest: wp.array(dtype=float),
    gain: wp.array(dtype=float),
    times: int,
):
    for _ in range(times):
        for t in range(pair.shape[0]):
            i = pair[t][0]
            j = pair[t][1]
            d = x[j] - x[i]
            length = wp.length(d)
            if length > 1.0e-9:
                move = d * (0.5 * gain[t] * (length - rest[t]) / length)
                x[i] = x[i] + move
                x[j] = x[j] - move


@wp.kernel
def find_below(
    mesh: wp.uint64, x: wp.array(dtype=wp.vec3), far: float, face: wp.array(dtype=int), at: wp.array(dtype=wp.vec2)
):
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, x[i], far)
    face[i] = -1
    if query.result:
        face[i] = query.face
        at[i] = wp.vec2(query.u, query.v)


@wp.kernel
def push_out(
    x: wp.array(dtype=wp.vec3),
    p: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    at: wp.array(dtype=wp.vec2),
    corner: wp.array(dtype=int),
    before: wp.array(dtype=wp.vec3),
    after: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    a0: float,
    a1: float,
    thickness: float,
    friction: float,
    ground: float,
):
    """Keeps a vertex `thickness` outside the surface point nearest to it; friction drags it along with the surface."""
    i = wp.tid()
    if x[i][1] < ground:
        x[i] = wp.vec3(p[i][0], ground, p[i][2])
    if face[i] >= 0:
        i0 = corner[3 * face[i]]
        i1 = corner[3 * face[i] + 1]
        i2 = corner[3 * face[i] + 2]
        u = at[i][0]
        v = at[i][1]
        w = 1.0 - u - v
        q0 = before[i0] * u + before[i1] * v + before[i2] * w
        q1 = after[i0] * u + after[i1] * v + after[i2] * w
        n = wp.normalize(normal[i0] * u + normal[i1] * v + normal[i2] * w)
        d = wp.dot(x[i] - (q0 + (q1 - q0) * a1), n)
        if d < thickness:
            x[i] = x[i] + n * (thickness - d)
            slip = (x[i] - p[i]) - (q1 - q0) * (a1 - a0)
            x[i] = x[i] - (slip - n * wp.dot(slip, n)) * friction


@wp.kernel
def update_velocity(
    x: wp.array(dtype=wp.vec3), p: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), dt: float, limit: float
):
    i = wp.tid()
    w = (x[i] - p[i]) / dt
    v[i] = w * wp.min(1.0, limit / wp.max(wp.length(w), 1.0e-9))


@wp.kernel
def pin(
    x: wp.array(dtype=wp.vec3), index: wp.array(dtype=int), gain: wp.array(dtype=float), goal: wp.array(dtype=wp.vec3)
):
    k = wp.tid()
    i = index[k]
    x[i] = x[i] + (goal[k] - x[i]) * gain[k]


@wp.kernel
def find_close(
    grid: wp.uint64,
    x: wp.array(dtype=wp.vec3),
    pattern: wp.array(dtype=wp.vec3),
    radius: float,
    close: wp.array(dtype=int),
    most: int,
):
    """Vertices that are near now, but far apart on the pattern."""
    i = wp.tid()
    query = wp.hash_grid_query(grid, x[i], radius)
    j = wp.int32(0)
    count = wp.int32(0)
    for k in range(most):
        close[i * most + k] = -1
    while wp.hash_grid_query_next(query, j):
        if j != i and count < most:
            if wp.length(x[i] - x[j]) < radius and wp.length(pattern[i] - pattern[j]) > 2.0 * radius:
                close[i * most + count] = j
                count += 1


@wp.kernel
def push_apart(
    x: wp.array(dtype=wp.vec3), y: wp.array(dtype=wp.vec3), close: wp.array(dtype=int), most: int, gap: float
):
    i = wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    count = wp.float32(0.0)
    for k in range(most):
        j = close[i * most + k]
        if j >= 0:
            d = x[i] - x[j]
            length = wp.length(d)
            if length < gap and length > 1.0e-9:
                total = total + d * (0.5 * (gap - length) / length)
                count += 1.0
    y[i] = x[i] + total / wp.max(count, 1.0)


def prepare() -> None:
    """Compiled kernels are kept in relight's cache folder (moved by RELIGHT_CACHE)."""
    folder = os.environ.get("RELIGHT_CACHE") or user_cache_path("relight")
    wp.config.kernel_cache_dir = os.path.join(str(folder), "warp")
    with quiet():
        wp.init()


@contextmanager
def quiet() -> Iterator[None]:
    """Holds back what Warp's native code writes to stderr where there is no GPU: the drape runs on the CPU anyway."""
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            os.write(2, b"".join(line for line in file if b"CUDA driver" not in line))


def vectors(values: np.ndarray) -> wp.array:
    return wp.array(np.ascontiguousarray(values, np.float32), dtype=wp.vec3, device="cpu")


class Collider:
    """A closed or open surface (V,3), (F,3) that moves from `before` to `after` during a frame."""

    def __init__(self, before: np.ndarray, after: np.ndarray, faces: np.ndarray):
        self.corner = wp.array(faces.astype(np.int32).ravel(), dtype=int, device="cpu")
        self.before, self.after = vectors(before), vectors(after)
        self.normal = vectors(normals(after, faces))
        self.mesh = wp.Mesh(points=self.after, indices=self.corner)

    def nearest(self, points: np.ndarray, far: float) -> tuple[np.ndarray, np.ndarray]:
        """For points (n,3): the face (n,) nearest to each, -1 beyond `far`, and its barycentric weights (n,3)."""
        face = wp.zeros(len(points), dtype=int, device="cpu")
        at = wp.zeros(len(points), dtype=wp.vec2, device="cpu")
        wp.launch(find_below, dim=len(points), inputs=[self.mesh.id, vectors(points), far, face, at], device="cpu")
        weights = at.numpy().astype(float)
        return face.numpy(), np.c_[weights, 1 - weights.sum(1)]


class Sheet:
    """One garment at one level of detail. pattern (n,3): its shape defines the lengths at rest."""

    def __init__(self, pattern: np.ndarray, faces: np.ndarray, cloth: Cloth):
        self.cloth, self.n, self.faces = cloth, len(pattern), faces
        stretch, face_edge, count = edges(faces)
        across = np.full((len(stretch), 2), -1)
        for side, opposite in ((0, 2), (1, 0), (2, 1)):
            edge = face_edge[:, side]
            first = across[edge, 0] < 0
            first[np.setdiff1d(np.arange(len(edge)), np.unique(edge, return_index=True)[1])] = False
            across[edge[first], 0] = faces[first, opposite]
            across[edge[~first], 1] = faces[~first, opposite]
        bend = across[(count == 2) & (across >= 0).all(1)]
        pairs = np.concatenate([bend, stretch])
        gain = np.r_[np.full(len(bend), cloth.bend), np.ones(len(stretch))]
        length = np.linalg.norm(pattern[pairs[:, 0]] - pattern[pairs[:, 1]], axis=1)
        self.edge, self.edge_rest = stretch, length[len(bend) :]
        self.mean = float(self.edge_rest.mean())
        self.pair = wp.array(pairs.astype(np.int32), dtype=wp.vec2i, device="cpu")
        self.rest = wp.array((length * (1 + cloth.crumple)).astype(np.float32), dtype=float, device="cpu")
        self.gain = wp.array(gain.astype(np.float32), dtype=float, device="cpu")
        self.pattern = vectors(pattern)
        self.x, self.p, self.y, self.v = vectors(pattern), vectors(pattern), vectors(pattern), vectors(pattern * 0)
        self.face = wp.zeros(self.n, dtype=int, device="cpu")
        self.at = wp.zeros(self.n, dtype=wp.vec2, device="cpu")
        self.close = wp.full(self.n * NEIGHBOURS, -1, dtype=int, device="cpu")
        self.grid = wp.HashGrid(64, 64, 64, device="cpu")

    def move_to(self, positions: np.ndarray) -> None:
        self.x = vectors(positions)
        self.v.zero_()

    def positions(self) -> np.ndarray:
        return self.x.numpy().astype(float)

    def strain(self) -> np.ndarray:
        """Length of each edge over its length on the pattern."""
        x = self.positions()
        return np.linalg.norm(x[self.edge[:, 0]] - x[self.edge[:, 1]], axis=1) / self.edge_rest

    def frame(self, below: Collider, effort: Effort, ground: float, damp: float) -> None:
        """Advances a sixtieth of a second."""
        dt, cloth = 1 / 60 / effort.substeps, self.cloth

        def launch(kernel: wp.Kernel, *inputs: object, dim: int = self.n) -> None:
            wp.launch(kernel, dim=dim, inputs=list(inputs), device="cpu")

        launch(find_below, below.mesh.id, self.x, FAR, self.face, self.at)
        if effort.contact:
            self.grid.build(self.x, self.mean)
            launch(find_close, self.grid.id, self.x, self.pattern, self.mean, self.close, NEIGHBOURS)
        contact = [self.face, self.at, below.corner, below.before, below.after, below.normal]
        for k in range(effort.substeps):
            launch(predict, self.x, self.v, self.p, effort.gravity, dt, damp)
            launch(hold_lengths, self.x, self.pair, self.rest, self.gain, effort.iterations, dim=1)
            if effort.contact:
                launch(push_apart, self.x, self.y, self.close, NEIGHBOURS, 0.9 * self.mean)
                self.x, self.y = self.y, self.x
            span = [k / effort.substeps, (k + 1) / effort.substeps]
            launch(push_out, self.x, self.p, *contact, *span, cloth.thickness, cloth.friction, ground)
            launch(update_velocity, self.x, self.p, self.v, dt, 3.0)

    def hold(self, index: wp.array, gain: wp.array, goal: np.ndarray, below: Collider, ground: float) -> None:
        """Pulls the pinned vertices to their goals, then out of what lies below."""
        wp.launch(pin, dim=len(index), inputs=[self.x, index, gain, vectors(goal)], device="cpu")
        contact = [self.face, self.at, below.corner, below.before, below.after, below.normal]
        wp.launch(
            push_out,
            dim=self.n,
            inputs=[self.x, self.x, *contact, 1.0, 1.0, self.cloth.thickness, 0.0, ground],
            device="cpu",
        )


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


@dataclass(frozen=True)
class Draped:
    """positions (n,3) at the finest level, history: level-0 positions at each frame, strain of the finest edges."""

    positions: np.ndarray
    history: list[np.ndarray]
    strain: np.ndarray


def mended(x: np.ndarray, faces: np.ndarray, edge: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Spreads single over-stretched edges, where a pin and a contact disagreed, over their neighbourhood."""
    torn = np.zeros(len(x))
    torn[edge[strain > 1.5].ravel()] = 1
    near = neighbours(faces, len(x))
    for _ in range(2):
        torn = np.maximum(torn, np.minimum(1, near @ torn * 2))
    for _ in range(8):
        x = x + (0.6 * torn)[:, None] * (near @ x - x)
    return x


def drape(
    levels: list[Level],
    refine: list,
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
        index = wp.array(held.astype(np.int32), dtype=int, device="cpu")
        gain = wp.array(level.pinned[held].astype(np.float32), dtype=float, device="cpu")
        moving = list(range(1, frames + 1)) if number == 0 else []
        if number == 0:
            history.append(sheet.positions())
        fine = number > 0
        surface = None
        for step, now in enumerate(moving + [frames] * effort.settle):
            if step < len(moving) or step == len(moving):
                last = now - 1 if step < len(moving) else now
                before, faces = below(last, fine)
                surface = Collider(before, below(now, fine)[0] if last != now else before, faces)
            sheet.frame(surface, effort, ground, damp=0.99 if step < len(moving) else 0.9)
            if len(held):
                goal = skin(level.weights[held], level.held[held], now)
                sheet.hold(index, gain, goal, surface, ground)
            if number == 0 and step < len(moving):
                history.append(sheet.positions())
        x = sheet.positions()
        if number == len(levels) - 1:
            x = mended(x, level.faces, sheet.edge, sheet.strain())
            sheet.move_to(x)
        strain = sheet.strain()
        if number == 0:
            history[-1] = x
        if number < len(levels) - 1:
            x = refine[number] @ x
    return Draped(x, history, strain)
