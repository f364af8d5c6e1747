"""Operations on triangle meshes: cuts, subdivision, borders, smoothing.

Where vertices are combinations of other vertices, a mesh is (matrix, faces). The sparse matrix (n,k) maps attributes
(positions, weights, fields) of k source vertices to its n vertices.
"""

import numpy as np
import scipy.sparse as sparse

Surface = tuple[np.ndarray, np.ndarray]  # vertices (V,3) and faces (F,3)


def edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the edges (E,2), the edge (F,3) of each side 01, 12, 20, and the number of faces (E,) at each edge."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1).astype(np.int64)
    n = int(faces.max(initial=0)) + 1
    unique, inverse, count = np.unique(sides[:, 0] * n + sides[:, 1], return_inverse=True, return_counts=True)
    return np.stack([unique // n, unique % n], axis=1), inverse.reshape(3, -1).T, count


def rim(faces: np.ndarray) -> np.ndarray:
    """Returns the directed border edges (m,2), sorted by their first vertex."""
    _, face_edge, count = edges(faces)
    out = np.concatenate([faces[count[face_edge[:, k]] == 1][:, [k, (k + 1) % 3]] for k in range(3)])
    return out[np.lexsort((out[:, 1], out[:, 0]))]


def neighbours(faces: np.ndarray, n: int) -> sparse.csr_matrix:
    """Returns the row-stochastic vertex adjacency (n,n), whose product with values averages them over neighbours."""
    e = edges(faces)[0]
    a = sparse.coo_matrix(
        (np.ones(2 * len(e)), (np.r_[e[:, 0], e[:, 1]], np.r_[e[:, 1], e[:, 0]])), shape=(n, n)
    ).tocsr()
    return sparse.diags(1 / np.maximum(np.asarray(a.sum(1)).ravel(), 1)) @ a


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns area-weighted unit vertex normals (V,3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    out = np.stack([np.bincount(faces.ravel(), np.repeat(flat[:, d], 3), len(vertices)) for d in range(3)], axis=1)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12)


def compacted(matrix: sparse.csr_matrix, faces: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Drops unused vertices."""
    used, inverse = np.unique(faces, return_inverse=True)
    return matrix[used], inverse.reshape(faces.shape)


def clip(
    matrix: sparse.csr_matrix, faces: np.ndarray, field: np.ndarray, snap: float = 0.35
) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Keeps the part of a surface where `field` (n,) > 0, cut along its zero line.

    A vertex whose distance from the line is less than `snap` of its edge moves onto it, which avoids slivers.
    """
    n, s = matrix.shape[0], field.astype(float).copy()
    e, face_edge, count = edges(faces)
    a, b = s[e[:, 0]], s[e[:, 1]]
    crossing = np.flatnonzero(a * b < 0)
    t = a[crossing] / (a[crossing] - b[crossing])
    near = np.concatenate([t, 1 - t])
    vertex, other = e[crossing].T.ravel(), e[crossing][:, ::-1].T.ravel()
    at_rim = np.zeros(n, bool)  # border vertices move along the border only
    at_rim[e[count == 1].ravel()] = True
    near = np.where(at_rim[vertex] & np.tile(count[crossing] != 1, 2), np.inf, near)
    order = np.lexsort((other, near, vertex))
    first = order[np.unique(vertex[order], return_index=True)[1]]
    first = first[near[first] < snap]
    move = sparse.eye(n, format="lil")
    move[vertex[first], vertex[first]] = 1 - near[first]
    move[vertex[first], other[first]] = near[first]
    matrix = move.tocsr() @ matrix
    s[vertex[first]] = 0
    a, b = s[e[:, 0]], s[e[:, 1]]
    crossing = np.flatnonzero(a * b < 0)
    t = a[crossing] / (a[crossing] - b[crossing])
    rows = np.arange(len(crossing))
    cut = sparse.csr_matrix(
        (np.r_[1 - t, t], (np.r_[rows, rows], np.r_[e[crossing, 0], e[crossing, 1]])), shape=(len(crossing), n)
    )
    matrix = sparse.vstack([matrix, cut @ matrix]).tocsr()
    at = np.full(len(e), -1)
    at[crossing] = n + rows
    inside = s[faces] >= 0
    whole = inside.all(1) & (s[faces] > 0).any(1)
    kept = [faces[whole]]
    for face, side in zip(faces[~whole & (s[faces] > 0).any(1)], face_edge[~whole & (s[faces] > 0).any(1)]):
        ring = []
        for k in range(3):
            if s[face[k]] >= 0:
                ring.append(face[k])
            if at[side[k]] >= 0:
                ring.append(at[side[k]])
        kept.append(np.array([[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]).reshape(-1, 3))
    return compacted(matrix, np.concatenate(kept).astype(np.int64))


def split(
    matrix: sparse.csr_matrix, faces: np.ndarray, field: np.ndarray
) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Inserts edges into a surface along the zero line of `field` (n,).

    Returns:
        The matrix to its vertices, its faces (F,3), and which of them (F,) lie on the positive side.
    """
    (ahead, front), (behind, back) = (clip(matrix, faces, sign * field) for sign in (1, -1))
    both = sparse.vstack([ahead, behind]).tocsr()
    # equal rows of the matrix are equal vertices
    place = np.round(both @ np.random.default_rng(0).random((both.shape[1], 3)), 9)
    _, first, inverse = np.unique(place, axis=0, return_index=True, return_inverse=True)
    joined = inverse.reshape(-1)[np.concatenate([front, back + ahead.shape[0]])]
    return both[first], joined, np.arange(len(joined)) < len(front)


def loop(faces: np.ndarray, n: int) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Subdivides once by Loop's scheme; returns the matrix (n+E,n) to the new vertices, and the new faces (4F,3).

    Loop, "Smooth subdivision surfaces based on triangles", 1987; borders follow the cubic B-spline rule.
    """
    e, face_edge, count = edges(faces)
    m, border = len(e), count == 1
    rows, columns, values = [], [], []

    def add(row: np.ndarray, column: np.ndarray, value: float | np.ndarray) -> None:
        rows.append(row)
        columns.append(column)
        values.append(np.broadcast_to(value, row.shape))

    for side, opposite in ((0, 2), (1, 0), (2, 1)):
        inner = ~border[face_edge[:, side]]
        add(n + face_edge[inner, side], faces[inner, opposite], 0.125)
    on_border = np.zeros(n, bool)
    on_border[e[border].ravel()] = True
    degree = np.bincount(e.ravel(), minlength=n)
    beta = np.where(degree == 3, 3 / 16, 3 / (8 * np.maximum(degree, 1)))
    for p, q in ((0, 1), (1, 0)):
        add(n + np.arange(m), e[:, p], np.where(border, 0.5, 0.375))
        inner = ~on_border[e[:, p]]
        add(e[inner, p], e[inner, q], beta[e[inner, p]])
        add(e[border, p], e[border, q], 0.125)
    add(np.arange(n), np.arange(n), np.where(on_border, 0.75, 1 - degree * beta))
    matrix = sparse.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(n + m, n)
    )
    matrix = sparse.diags(1 / np.asarray(matrix.sum(1)).ravel()) @ matrix
    a, b, c = faces.T
    ab, bc, ca = (n + face_edge).T
    corners = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return matrix.tocsr(), np.concatenate([np.stack(corner, axis=1) for corner in corners])


def border_loops(faces: np.ndarray) -> list[np.ndarray]:
    """Returns the border as vertex loops, each in the direction of its faces, longest first."""
    following = dict(rim(faces).tolist())
    loops = []
    while following:
        start = next(iter(following))
        ring = [start]
        while (after := following.pop(ring[-1], None)) is not None and after != start:
            ring.append(after)
        loops.append(np.array(ring))
    return sorted(loops, key=len, reverse=True)


def border_distance(vertices: np.ndarray, faces: np.ndarray, rings: int) -> np.ndarray:
    """Returns the number of edges (V,) from each vertex to the border, at most `rings`."""
    e, _, count = edges(faces)
    out = np.full(len(vertices), rings)
    out[e[count == 1].ravel()] = 0
    for ring in range(1, rings):
        for p, q in ((0, 1), (1, 0)):
            near = e[out[e[:, p]] == ring - 1, q]
            out[near] = np.minimum(out[near], ring)
    return out


def near_border(vertices: np.ndarray, faces: np.ndarray, rings: int) -> np.ndarray:
    """Returns which faces (F,) have a vertex less than `rings` edges from the border."""
    return (border_distance(vertices, faces, rings)[faces] < rings).any(1)


def thickened(
    vertices: np.ndarray, faces: np.ndarray, depth: float, rings: int | None = 3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Adds a visible edge to cloth: an inner layer near the border, joined to the outer one.

    Args:
        vertices: (V,3) metres.
        faces: (F,3).
        depth: metres between the layers.
        rings: width of the inner layer in edges; None for all of the cloth, if both sides are seen.

    Returns:
        Vertices (V',3), faces that begin with the given ones, and the outer vertex (V',) of each vertex.
    """
    band = np.ones(len(faces), bool) if rings is None else near_border(vertices, faces, rings)
    used, inverse = np.unique(faces[band], return_inverse=True)
    inner = len(vertices) + inverse.reshape(-1, 3)
    below = vertices[used] - normals(vertices, faces)[used] * depth
    position = np.full(len(vertices), -1)
    position[used] = len(vertices) + np.arange(len(used))
    sides = rim(faces)
    a, b = sides[(position[sides] >= 0).all(1)].T
    walls = np.concatenate([np.stack([b, a, position[a]], 1), np.stack([b, position[a], position[b]], 1)])
    out = np.concatenate([faces, inner[:, ::-1], walls])
    return np.concatenate([vertices, below]), out, np.concatenate([np.arange(len(vertices)), used])


def smoothed(values: np.ndarray, faces: np.ndarray, times: int) -> np.ndarray:
    """Returns vertex values (V,...) after Laplacian smoothing."""
    around = neighbours(faces, len(values))
    for _ in range(times):
        values = 0.5 * values + 0.5 * (around @ values)
    return values


def extruded(ring: np.ndarray, rows: list[np.ndarray], offset: int, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Builds a strip that continues a border, with faces of the same orientation.

    Args:
        ring: (m,) vertices of the border, in order.
        rows: (m,3) points of each row.
        offset: index of the first new vertex.
        closed: whether the border is a closed loop.

    Returns:
        New vertices and faces.
    """
    m, previous, faces = len(ring), ring, []
    for k in range(len(rows)):
        now = offset + k * m + np.arange(m)
        j = np.arange(m if closed else m - 1)
        a, b, c, d = previous[j], previous[(j + 1) % m], now[j], now[(j + 1) % m]
        faces += [np.stack([b, a, c], 1), np.stack([b, c, d], 1)]
        previous = now
    return np.concatenate(rows), np.concatenate(faces)


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Returns the triangles of a grid with rows downward and columns to the right, as seen."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def longest_run(ring: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Returns the longest run of chosen vertices in a closed ring (m,), of which at least one is not chosen."""
    starts = np.flatnonzero(chosen & ~np.roll(chosen, 1))
    return max((np.roll(ring, -k)[: int(np.argmin(np.roll(chosen, -k)))] for k in starts), key=len)


def stacked(parts: list[Surface]) -> Surface:
    """Joins several surfaces into one."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    return np.concatenate([v for v, _ in parts]), np.concatenate([f + s for (_, f), s in zip(parts, starts)])
