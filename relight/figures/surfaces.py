"""Operations on triangle meshes: cuts, subdivision, borders, smoothing.

Where vertices are combinations of other vertices, a mesh is (matrix, faces). The sparse matrix (n,k) maps attributes
(positions, weights, fields) of k source vertices to its n vertices.
"""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import dijkstra

from relight.meshes.geometry import edges

Surface = tuple[np.ndarray, np.ndarray]  # vertices (V,3) and faces (F,3)
Textured = tuple[np.ndarray, np.ndarray, np.ndarray]  # vertices (V,3), faces (F,3), and uv (F,3,2) of their corners
Combined = tuple[sparse.csr_matrix, np.ndarray]  # matrix (n,k) and faces (F,3)


def rim(faces: np.ndarray) -> np.ndarray:
    """Returns the border edges (m,2), directed as in their faces and sorted by their first vertex."""
    _, face_edge, count = edges(faces)
    border = np.concatenate([faces[count[face_edge[:, k]] == 1][:, [k, (k + 1) % 3]] for k in range(3)])
    return border[np.lexsort((border[:, 1], border[:, 0]))]


def neighbours(faces: np.ndarray, n: int) -> sparse.csr_matrix:
    """Returns the row-stochastic vertex adjacency (n,n), whose product with values averages them over neighbours."""
    first, second = edges(faces)[0].T
    both_ways = np.r_[first, second], np.r_[second, first]
    adjacency = sparse.coo_matrix((np.ones(2 * len(first)), both_ways), shape=(n, n)).tocsr()
    return sparse.diags(1 / np.maximum(np.asarray(adjacency.sum(1)).ravel(), 1)) @ adjacency


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns area-weighted unit vertex normals (V,3)."""
    of_faces = np.repeat(face_normals(vertices, faces), 3, axis=0)
    sums = np.stack([np.bincount(faces.ravel(), of_faces[:, axis], len(vertices)) for axis in range(3)], axis=1)
    return unit_rows(sums, 1e-12)


def unit_rows(vectors: np.ndarray, least: float = 1e-9) -> np.ndarray:
    """Returns vectors (...,k) divided by their length, or by `least` where they are shorter."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), least)


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Returns the normals (F,3) of faces, each as long as twice the face's area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def compacted(matrix: sparse.csr_matrix, faces: np.ndarray) -> Combined:
    """Returns a surface, matrix (n,k) and faces (F,3), without the vertices that no face uses."""
    used, inverse = np.unique(faces, return_inverse=True)
    return matrix[used], inverse.reshape(faces.shape)


def clip(matrix: sparse.csr_matrix, faces: np.ndarray, field: np.ndarray, snap: float = 0.35) -> Combined:
    """Keeps the part of a surface where a field is positive, cut along its zero line.

    Args:
        matrix: (n,k) from source vertices to those of the surface.
        faces: (F,3).
        field: (n,) at the vertices of the surface.
        snap: a vertex whose distance from the line is less than this share of its edge moves onto it, which avoids
            slivers.

    Returns:
        The matrix (m,k) from source vertices to those of the part, and its faces.
    """
    n, field = matrix.shape[0], field.astype(float).copy()
    edge, face_edge, count = edges(faces)
    vertex, other, share = _snapped_vertices(edge, count == 1, field, snap)
    move = sparse.eye(n, format="lil")
    move[vertex, vertex] = 1 - share
    move[vertex, other] = share
    matrix = move.tocsr() @ matrix
    field[vertex] = 0
    crossing, share = _zero_crossings(edge, field)
    rows = np.arange(len(crossing))
    ends = np.r_[edge[crossing, 0], edge[crossing, 1]]
    cut = sparse.csr_matrix((np.r_[1 - share, share], (np.r_[rows, rows], ends)), shape=(len(crossing), n))
    matrix = sparse.vstack([matrix, cut @ matrix]).tocsr()
    cut_vertex = np.full(len(edge), -1)  # the new vertex on each edge
    cut_vertex[crossing] = n + rows
    reaches_in = (field[faces] > 0).any(1)
    is_whole = reaches_in & (field[faces] >= 0).all(1)
    kept = [faces[is_whole]]
    is_cut = reaches_in & ~is_whole
    for face, sides in zip(faces[is_cut], face_edge[is_cut]):
        polygon = []  # what is left of the face, in its order
        for corner, side in zip(face, sides):
            if field[corner] >= 0:
                polygon.append(corner)
            if cut_vertex[side] >= 0:
                polygon.append(cut_vertex[side])
        fan = [[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, len(polygon) - 1)]
        kept.append(np.array(fan).reshape(-1, 3))
    return compacted(matrix, np.concatenate(kept).astype(np.int64))


def _zero_crossings(edge: np.ndarray, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the indices (c,) of edges (E,2) on which a field (n,) changes its sign, and where, from 0 to 1 (c,)."""
    first, second = field[edge[:, 0]], field[edge[:, 1]]
    crossing = np.flatnonzero(first * second < 0)
    return crossing, first[crossing] / (first[crossing] - second[crossing])


def _snapped_vertices(
    edge: np.ndarray, is_border: np.ndarray, field: np.ndarray, snap: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the vertices that move onto the zero line of a field, each along the edge on which the line is nearest.

    Vertices of the border move along the border only, and none by more than `snap` of the edge. Returns the vertices
    (m,), ascending; the other ends (m,) of their edges; the shares (m,) of the way there.
    """
    crossing, position = _zero_crossings(edge, field)
    vertex, other = edge[crossing].T.ravel(), edge[crossing][:, ::-1].T.ravel()  # both ends of each edge
    share = np.concatenate([position, 1 - position])
    at_border = np.zeros(len(field), bool)
    at_border[edge[is_border].ravel()] = True
    share = np.where(at_border[vertex] & np.tile(~is_border[crossing], 2), np.inf, share)
    order = np.lexsort((other, share, vertex))
    nearest = order[np.unique(vertex[order], return_index=True)[1]]
    nearest = nearest[share[nearest] < snap]
    return vertex[nearest], other[nearest], share[nearest]


def split(
    matrix: sparse.csr_matrix, faces: np.ndarray, field: np.ndarray
) -> tuple[sparse.csr_matrix, np.ndarray, np.ndarray]:
    """Inserts edges into a surface along the zero line of a field.

    Args:
        matrix: (n,k) from source vertices to those of the surface.
        faces: (F,3).
        field: (n,) at the vertices, linear on each edge.

    Returns:
        The matrix (m,k) to its new vertices, its faces (F',3), and which of them (F',) lie on the positive side.
    """
    (positive, positive_faces), (negative, negative_faces) = (clip(matrix, faces, sign * field) for sign in (1, -1))
    both = sparse.vstack([positive, negative]).tocsr()
    # Both parts have the vertices of the line. Equal rows of the matrix are equal vertices, told by random positions of
    # the source vertices: different rows give different points.
    points = np.round(both @ np.random.default_rng(0).random((both.shape[1], 3)), 9)
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    joined = inverse.reshape(-1)[np.concatenate([positive_faces, negative_faces + positive.shape[0]])]
    return both[first], joined, np.arange(len(joined)) < len(positive_faces)


def loop(faces: np.ndarray, n: int) -> Combined:
    """Subdivides a mesh once by Loop's scheme.

    Loop, "Smooth subdivision surfaces based on triangles", 1987; borders follow the cubic B-spline rule. The n old
    vertices come first, then one on each edge: 3/8 of both ends and 1/8 of both opposite corners, 1/2 of both ends on
    the border. Old vertices move by beta toward each neighbour, on the border by 1/8 toward both neighbours on it.

    Args:
        faces: (F,3).
        n: number of vertices.

    Returns:
        The matrix (n+E,n) from the old vertices to the new ones, whose rows sum to 1, and the new faces (4F,3), in four
        blocks as `quarters` has them.
    """
    edge, face_edge, count = edges(faces)
    edge_count, is_border = len(edge), count == 1
    rows, columns, values = [], [], []

    def add(row: np.ndarray, column: np.ndarray, value: float | np.ndarray) -> None:
        rows.append(row)
        columns.append(column)
        values.append(np.broadcast_to(value, row.shape))

    for side, opposite in ((0, 2), (1, 0), (2, 1)):
        inner = ~is_border[face_edge[:, side]]
        add(n + face_edge[inner, side], faces[inner, opposite], 0.125)
    on_border = np.zeros(n, bool)
    on_border[edge[is_border].ravel()] = True
    degree = np.bincount(edge.ravel(), minlength=n)
    beta = np.where(degree == 3, 3 / 16, 3 / (8 * np.maximum(degree, 1)))
    for end, other in ((0, 1), (1, 0)):
        add(n + np.arange(edge_count), edge[:, end], np.where(is_border, 0.5, 0.375))
        inner = ~on_border[edge[:, end]]
        add(edge[inner, end], edge[inner, other], beta[edge[inner, end]])
        add(edge[is_border, end], edge[is_border, other], 0.125)
    add(np.arange(n), np.arange(n), np.where(on_border, 0.75, 1 - degree * beta))
    places = np.concatenate(rows), np.concatenate(columns)
    matrix = sparse.csr_matrix((np.concatenate(values), places), shape=(n + edge_count, n))
    matrix = sparse.diags(1 / np.asarray(matrix.sum(1)).ravel()) @ matrix
    return matrix.tocsr(), quarters(faces, n + face_edge)


def quarters(corners: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Returns the four triangles (4F,3,...) into which the middles of its sides divide each triangle.

    Args:
        corners: (F,3,...) a, b, c of each triangle: indices of vertices, or points.
        middles: (F,3,...) those of its sides ab, bc, ca.
    """
    a, b, c = corners.swapaxes(0, 1)
    ab, bc, ca = middles.swapaxes(0, 1)
    triangles = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(triangle, axis=1) for triangle in triangles])


def cut_cells(index: np.ndarray, first: str, second: str, by_row: bool = False) -> np.ndarray:
    """Cuts each cell of a grid into two triangles.

    Args:
        index: (..., rows, columns) vertices of one or more grids.
        first, second: corners of the triangles, in order: "acb" or the like, where a and b are the left and the right
            corner in the upper row of a cell, c and d those in its lower row.
        by_row: whether the second triangles of a row of cells follow its first ones; else those of all cells do.

    Returns:
        Faces (F,3).
    """
    upper, lower = index[..., :-1, :], index[..., 1:, :]
    corner = {"a": upper[..., :-1], "b": upper[..., 1:], "c": lower[..., :-1], "d": lower[..., 1:]}
    triangles = [np.stack([corner[letter] for letter in letters], axis=-1) for letters in (first, second)]
    return np.stack(triangles, axis=-3 if by_row else 0).reshape(-1, 3)


def ring_grid(rows: int, sides: int) -> np.ndarray:
    """Returns a grid of vertex indices (rows, sides + 1) of rings, whose last column is its first one."""
    return np.pad(np.arange(rows * sides).reshape(rows, sides), ((0, 0), (0, 1)), mode="wrap")


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
    """Counts edges to the border of a mesh.

    Args:
        vertices: (V,3).
        faces: (F,3).
        rings: largest count.

    Returns:
        The least number of edges (V,) from each vertex to one on the border, at most `rings`.
    """
    graph, border = neighbours(faces, len(vertices)), np.unique(rim(faces))
    distance = dijkstra(graph, indices=border, unweighted=True, limit=rings, min_only=True)
    return np.minimum(distance, rings)


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
        Vertices (V',3), faces (F',3) that begin with the given ones, and for their corners (F',3) those of the given
        faces, flattened, from which they come. All corners of a face come from one given face.
    """
    corner = np.arange(faces.size).reshape(-1, 3)
    band = np.ones(len(faces), bool)
    if rings is not None:
        band = (border_distance(vertices, faces, rings)[faces] < rings).any(1)
    used, inverse = np.unique(faces[band], return_inverse=True)
    inner_faces = len(vertices) + inverse.reshape(-1, 3)
    inner_vertices = vertices[used] - normals(vertices, faces)[used] * depth
    inner_of = np.full(len(vertices), -1)  # the inner vertex of each outer one
    inner_of[used] = len(vertices) + np.arange(len(used))
    _, face_edge, count = edges(faces)
    border = count[face_edge] == 1
    start, end = corner[border], np.roll(corner, -1, axis=1)[border]
    a, b = faces.ravel()[start], faces.ravel()[end]
    walls = [np.stack([b, a, inner_of[a]], 1), np.stack([b, inner_of[a], inner_of[b]], 1)]
    all_faces = np.concatenate([faces, inner_faces[:, ::-1], *walls])
    source = [corner, corner[band][:, ::-1], np.stack([end, start, start], 1), np.stack([end, start, end], 1)]
    return np.concatenate([vertices, inner_vertices]), all_faces, np.concatenate(source)


def averaged(values: np.ndarray, average: sparse.csr_matrix, times: int) -> np.ndarray:
    """Returns vertex values (V,...) averaged `times` with those of their neighbours, half and half.

    `average` (V,V) takes values to the means of the neighbours' values.
    """
    for _ in range(times):
        values = 0.5 * values + 0.5 * (average @ values)
    return values


def smoothed(values: np.ndarray, faces: np.ndarray, times: int) -> np.ndarray:
    """Returns vertex values (V,...) after Laplacian smoothing: `times` half-way to the mean of their neighbours."""
    return averaged(values, neighbours(faces, len(values)), times)


def smooth_line(values: np.ndarray, times: int, closed: bool) -> np.ndarray:
    """Returns values (m,...) along a line, averaged `times` with neighbours; the ends of an open line stay."""
    for _ in range(times):
        mean = 0.5 * values + 0.25 * (np.roll(values, 1, 0) + np.roll(values, -1, 0))
        if not closed:
            mean[[0, -1]] = values[[0, -1]]
        values = mean
    return values


def extruded(ring: np.ndarray, rows: list[np.ndarray], offset: int, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Builds a strip that continues a border, with faces of the same orientation.

    Args:
        ring: (m,) vertices of the border, in order.
        rows: (m,3) points of each row, from the border outward.
        offset: index of the first new vertex.
        closed: whether the border is a closed loop.

    Returns:
        The new vertices (V,3), and faces (F,3) whose indices count the border's vertices and the new ones.
    """
    points = np.concatenate(rows)
    index = np.concatenate([ring, offset + np.arange(len(points))]).reshape(-1, len(ring))
    return points, cut_cells(np.c_[index, index[:, 0]] if closed else index, "bac", "bcd", by_row=True)


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Returns the triangles (F,3) of a grid of vertices, row by row, that face a viewer who sees row 0 at the top."""
    return cut_cells(np.arange(rows * columns).reshape(rows, columns), "acb", "bcd")


def longest_run(ring: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Returns the longest run of chosen vertices in a closed ring.

    Args:
        ring: (m,) vertices in order.
        chosen: (m,) bool; at least one is chosen, and at least one is not.
    """
    runs = []
    for start in np.flatnonzero(chosen & ~np.roll(chosen, 1)):  # chosen, and the vertex before is not
        length = int(np.argmin(np.roll(chosen, -start)))  # up to the first that is not chosen
        runs.append(np.roll(ring, -start)[:length])
    return max(runs, key=len)


def stacked(parts: list[Surface]) -> Surface:
    """Joins several surfaces, each vertices (V,3) and faces (F,3), into one, without joining their vertices."""
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = [faces + start for (_, faces), start in zip(parts, starts)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)
