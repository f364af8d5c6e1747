"""Cloth simulation in Warp: stretch and bending constraints, contacts with the layers below, self-contact, friction.

The method is extended position-based dynamics (Macklin, Mueller, Chentanez, "XPBD: position-based simulation of
compliant constrained dynamics", 2016) in the rigid limit, with relaxation factors. Constraints are solved in a fixed
order (Gauss-Seidel), so results are the same to the last bit in every process.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from relight.figures.drape import kernels
from relight.figures.drape.colliders import Collider, vec3_array
from relight.figures.draw.garments import Cloth
from relight.meshes.geometry import edges

GRAVITY = -9.8  # metres per second squared
FRAME_TIME = 1 / 60  # seconds
MAX_SPEED = 3.0  # metres per second
MAX_PARTNERS = 8  # vertices that self-contact tests per vertex
BEND_EDGE = 0.025  # edge length to which `Cloth.bend` refers, metres
CONTACT_RANGE = 0.15  # search range of the collider's nearest face, metres


@dataclass(frozen=True)
class SolverSettings:
    """How one level of detail is simulated.

    Attributes:
        substeps: per frame.
        iterations: over all constraints, per substep.
        settle_frames: at the end, without motion of the body.
        gravity: metres per second squared.
    """

    substeps: int
    iterations: int
    settle_frames: int
    gravity: float = GRAVITY


def bending_pairs(faces: np.ndarray) -> np.ndarray:
    """Returns the two vertices opposite each inner edge (m,2), in the order of `edges`.

    A constraint on their distance resists bending at the edge.
    """
    edge_vertices, face_edge, uses = edges(faces)
    opposite = np.full((len(edge_vertices), 2), -1)
    for side, corner in ((0, 2), (1, 0), (2, 1)):  # of a face, and the corner opposite that side
        edge = face_edge[:, side]
        is_first = np.zeros(len(edge), bool)  # whether a face is the first one at this edge
        is_first[np.unique(edge, return_index=True)[1]] = True
        is_first &= opposite[edge, 0] < 0
        opposite[edge[is_first], 0] = faces[is_first, corner]
        opposite[edge[~is_first], 1] = faces[~is_first, corner]
    return opposite[(uses == 2) & (opposite >= 0).all(1)]


class ClothSolver:
    """Simulates one garment at one level of detail.

    Args:
        rest_shape: (n,3) vertices of the pattern, metres; they define the rest lengths.
        faces: (F,3).
        cloth: the fabric's properties.

    Attributes:
        edges: (E,2) the edges.
        edge_length: (E,) of the edges on the pattern, metres.
        mean_edge: their mean, metres.
        pairs, rest_length, stiffness: of the distance constraints: those that resist bending, then the edges.
        x, v: positions, metres, and velocities of the n vertices.
        previous, resolved: positions before a substep, and buffer for those after self-contacts.
        contact_face, contact_barycentric: the collider's nearest face and point for each vertex.
        partners: MAX_PARTNERS vertices in self-contact with each vertex, -1 for none.
        grid: hash grid in which these are searched.
    """

    def __init__(self, rest_shape: np.ndarray, faces: np.ndarray, cloth: Cloth):
        self.cloth, self.n = cloth, len(rest_shape)
        self.edges = edges(faces)[0]
        bend = bending_pairs(faces)
        pairs = np.concatenate([bend, self.edges])
        length = np.linalg.norm(rest_shape[pairs[:, 0]] - rest_shape[pairs[:, 1]], axis=1)
        self.edge_length = length[len(bend) :]
        self.mean_edge = float(self.edge_length.mean())
        # shorter edges bend at more places: without this factor a finer mesh would be stiffer cloth
        bend_factor = min(1.0, self.edge_length.mean() / BEND_EDGE) ** 1.5
        stiffness = np.r_[np.full(len(bend), cloth.bend * bend_factor), np.ones(len(self.edges))]
        self.pairs: wp.array = wp.array(pairs.astype(np.int32), dtype=wp.vec2i)
        self.rest_length: wp.array = wp.array((length * (1 + cloth.extra_length)).astype(np.float32), dtype=float)
        self.stiffness: wp.array = wp.array(stiffness.astype(np.float32), dtype=float)
        self.rest_shape = vec3_array(rest_shape)
        self.x, self.previous, self.resolved = (vec3_array(rest_shape) for _ in range(3))
        self.v = vec3_array(rest_shape * 0)
        self.contact_face = wp.zeros(self.n, dtype=int)
        self.contact_barycentric = wp.zeros(self.n, dtype=wp.vec2)
        self.partners = wp.full(self.n * MAX_PARTNERS, -1, dtype=int)
        self.grid = wp.HashGrid(64, 64, 64)

    def move_to(self, positions: np.ndarray) -> None:
        """Sets the vertices to positions (n,3), with velocity 0."""
        self.x = vec3_array(positions)
        self.v.zero_()

    def positions(self) -> np.ndarray:
        """Returns the vertices (n,3), metres."""
        return self.x.numpy().astype(float)

    def strain(self) -> np.ndarray:
        """Returns each edge's length over its length on the pattern (E,)."""
        x = self.positions()
        return np.linalg.norm(x[self.edges[:, 0]] - x[self.edges[:, 1]], axis=1) / self.edge_length

    def contacts(self, collider: Collider) -> list[wp.array]:
        """Returns the arguments of the kernel `resolve_contacts` that give the nearest faces and the collider."""
        nearest = [self.contact_face, self.contact_barycentric]
        return [*nearest, collider.indices, collider.start, collider.end, collider.normals]

    def step_frame(self, collider: Collider, settings: SolverSettings, ground: float, damping: float) -> None:
        """Advances the simulation by one frame.

        Args:
            collider: the surface below the cloth, which moves during the frame.
            settings: of this level of detail.
            ground: height below which no vertex may be, metres.
            damping: factor of the velocities, per substep.
        """
        dt, cloth = FRAME_TIME / settings.substeps, self.cloth

        def launch(kernel: wp.Kernel, *inputs: object) -> None:
            wp.launch(kernel, dim=self.n, inputs=list(inputs))

        contact, partners = [self.contact_face, self.contact_barycentric], [self.partners, MAX_PARTNERS]
        launch(kernels.find_nearest_faces, collider.mesh.id, self.x, CONTACT_RANGE, *contact)
        self.grid.build(self.x, self.mean_edge)
        launch(kernels.find_self_contacts, self.grid.id, self.x, self.rest_shape, self.mean_edge, *partners)
        for k in range(settings.substeps):
            launch(kernels.integrate, self.x, self.v, self.previous, settings.gravity, dt, damping)
            inputs = [self.x, self.pairs, self.rest_length, self.stiffness, len(self.pairs), settings.iterations]
            wp.launch(kernels.solve_distance_constraints, dim=1, inputs=inputs)
            launch(kernels.resolve_self_contacts, self.x, self.resolved, *partners, 0.9 * self.mean_edge)
            self.x, self.resolved = self.resolved, self.x
            times = [k / settings.substeps, (k + 1) / settings.substeps]  # of the substep's start and end in the frame
            surface = [*self.contacts(collider), *times, cloth.thickness, cloth.friction, ground]
            launch(kernels.resolve_contacts, self.x, self.previous, *surface)
            launch(kernels.update_velocity, self.x, self.previous, self.v, dt, MAX_SPEED)

    def pin(self, index: np.ndarray, weight: np.ndarray, target: np.ndarray, collider: Collider, ground: float) -> None:
        """Pulls vertices to their targets, then resolves contacts.

        Vertices with a weight above .99 end exactly at their targets, even below the surface of the collider: folds
        below must not drag a waistband down.

        Args:
            index: (m,) the pinned vertices.
            weight: (m,) in [0,1].
            target: (m,3) metres.
            collider: the surface below the cloth.
            ground: height below which no vertex may be, metres.
        """
        vertices: wp.array = wp.array(index.astype(np.int32), dtype=int)
        soft: wp.array = wp.array(weight.astype(np.float32), dtype=float)
        hard: wp.array = wp.array((weight > 0.99).astype(np.float32), dtype=float)
        targets = vec3_array(target)
        wp.launch(kernels.pull_to_targets, dim=len(index), inputs=[self.x, vertices, soft, targets])
        times, friction = [1.0, 1.0], 0.0  # the collider stands still at the end of the frame
        surface = [*self.contacts(collider), *times, self.cloth.thickness, friction, ground]
        wp.launch(kernels.resolve_contacts, dim=self.n, inputs=[self.x, self.x, *surface])
        wp.launch(kernels.pull_to_targets, dim=len(index), inputs=[self.x, vertices, hard, targets])
