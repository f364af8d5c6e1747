"""Warp kernels of the drape: prediction, lengths, contact with what lies below, self-contact, rays, and crossings."""

import warp as wp


@wp.kernel
def predict(
    x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), p: wp.array(dtype=wp.vec3), g: float, dt: float, damp: float
):
    """Moves each vertex by its velocity v and by gravity g for a time dt; p keeps where it was."""
    i = wp.tid()
    p[i] = x[i]
    x[i] = x[i] + v[i] * (dt * damp) + wp.vec3(0.0, g * dt * dt, 0.0)


@wp.kernel
def hold_lengths(
    x: wp.array(dtype=wp.vec3),
    pair: wp.array(dtype=wp.vec2i),
    rest: wp.array(dtype=float),
    gain: wp.array(dtype=float),
    first: int,
    last: int,
    step: int,
    times: int,
):
    """Each thread solves every `step`-th of the pairs [first, last), one after the other, `times` over."""
    for _ in range(times):
        for t in range(first + wp.tid(), last, step):
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
    """The face of the mesh that is nearest to each vertex, -1 beyond `far`, and the place on it (barycentric)."""
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
    """The velocity from where each vertex was (p) and is (x), at most `limit`."""
    i = wp.tid()
    w = (x[i] - p[i]) / dt
    v[i] = w * wp.min(1.0, limit / wp.max(wp.length(w), 1.0e-9))


@wp.kernel
def pin(
    x: wp.array(dtype=wp.vec3), index: wp.array(dtype=int), gain: wp.array(dtype=float), goal: wp.array(dtype=wp.vec3)
):
    """Moves the vertices `index` toward their goals, by a share `gain` of the way."""
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
    """Keeps vertices that `find_close` found at least `gap` apart; y: where they go."""
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


@wp.kernel
def first_hit(
    mesh: wp.uint64,
    origin: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    depth: wp.array(dtype=float),
):
    """The first face that each ray meets within 10 m, -1 for none, and its distance."""
    i = wp.tid()
    hit = wp.mesh_query_ray(mesh, origin[i], direction[i], 10.0)
    face[i] = -1
    if hit.result:
        face[i] = hit.face
        depth[i] = hit.t


@wp.func
def through(a0: wp.vec3, a1: wp.vec3, a2: wp.vec3, b0: wp.vec3, b1: wp.vec3, b2: wp.vec3) -> float:
    """How far the triangle a reaches to both sides of the plane of b, metres; negative where it does not cross it."""
    n = wp.normalize(wp.cross(b1 - b0, b2 - b0))
    s0 = wp.dot(a0 - b0, n)
    s1 = wp.dot(a1 - b0, n)
    s2 = wp.dot(a2 - b0, n)
    return wp.min(wp.max(s0, wp.max(s1, s2)), -wp.min(s0, wp.min(s1, s2)))


@wp.kernel
def find_crossing(
    mesh: wp.uint64,
    x: wp.array(dtype=wp.vec3),
    corner: wp.array(dtype=int),
    middle: wp.array(dtype=wp.vec3),
    owner: wp.array(dtype=int),
    deep: float,
    apart: float,
    crosses: wp.array(dtype=int),
):
    """Marks the faces that reach deeper than `deep` through another one that is not their neighbour."""
    f = wp.tid()
    a0 = x[corner[3 * f]]
    a1 = x[corner[3 * f + 1]]
    a2 = x[corner[3 * f + 2]]
    query = wp.mesh_query_aabb(mesh, wp.min(a0, wp.min(a1, a2)), wp.max(a0, wp.max(a1, a2)))
    g = wp.int32(0)
    while wp.mesh_query_aabb_next(query, g):
        if owner[f] != owner[g] or wp.length(middle[f] - middle[g]) > apart:
            b0 = x[corner[3 * g]]
            b1 = x[corner[3 * g + 1]]
            b2 = x[corner[3 * g + 2]]
            if through(a0, a1, a2, b0, b1, b2) > deep and through(b0, b1, b2, a0, a1, a2) > deep:
                if wp.intersect_tri_tri(a0, a1, a2, b0, b1, b2) != 0:
                    crosses[f] = 1
