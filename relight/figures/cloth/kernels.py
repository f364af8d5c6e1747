"""Warp kernels of the cloth solver: integration, distance constraints, contacts, pins, ray casts, intersections."""

import warp as wp


@wp.kernel
def integrate(
    x: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    previous: wp.array(dtype=wp.vec3),
    gravity: float,
    dt: float,
    damping: float,
):
    """Advances positions x by velocities v and gravity over a time dt; `previous` keeps the positions before."""
    i = wp.tid()
    previous[i] = x[i]
    x[i] = x[i] + v[i] * (dt * damping) + wp.vec3(0.0, gravity * dt * dt, 0.0)


@wp.kernel
def solve_distance_constraints(
    x: wp.array(dtype=wp.vec3),
    pairs: wp.array(dtype=wp.vec2i),
    rest_length: wp.array(dtype=float),
    stiffness: wp.array(dtype=float),
    count: int,
    iterations: int,
):
    """Solves all constraints in order, `iterations` times. It runs in one thread, since they share vertices."""
    for _ in range(iterations):
        for t in range(count):
            i = pairs[t][0]
            j = pairs[t][1]
            d = x[j] - x[i]
            length = wp.length(d)
            if length > 1.0e-9:
                move = d * (0.5 * stiffness[t] * (length - rest_length[t]) / length)
                x[i] = x[i] + move
                x[j] = x[j] - move


@wp.kernel
def find_nearest_faces(
    mesh: wp.uint64,
    x: wp.array(dtype=wp.vec3),
    max_distance: float,
    face: wp.array(dtype=int),
    barycentric: wp.array(dtype=wp.vec2),
):
    """Finds the face of the mesh nearest to each vertex, -1 beyond `max_distance`, and the nearest point on it."""
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, x[i], max_distance)
    face[i] = -1
    if query.result:
        face[i] = query.face
        barycentric[i] = wp.vec2(query.u, query.v)


@wp.kernel
def resolve_contacts(
    x: wp.array(dtype=wp.vec3),
    previous: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    barycentric: wp.array(dtype=wp.vec2),
    indices: wp.array(dtype=int),
    start: wp.array(dtype=wp.vec3),
    end: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    time0: float,
    time1: float,
    thickness: float,
    friction: float,
    ground: float,
):
    """Keeps each vertex `thickness` outside the collider, which moves from time0 to time1 in [0,1] of its frame.

    Friction drags the vertex along with the collider. Below the ground it returns to where it was.
    """
    i = wp.tid()
    if x[i][1] < ground:
        x[i] = wp.vec3(previous[i][0], ground, previous[i][2])
    if face[i] >= 0:
        i0 = indices[3 * face[i]]
        i1 = indices[3 * face[i] + 1]
        i2 = indices[3 * face[i] + 2]
        u = barycentric[i][0]
        v = barycentric[i][1]
        w = 1.0 - u - v
        q0 = start[i0] * u + start[i1] * v + start[i2] * w
        q1 = end[i0] * u + end[i1] * v + end[i2] * w
        n = wp.normalize(normal[i0] * u + normal[i1] * v + normal[i2] * w)
        distance = wp.dot(x[i] - (q0 + (q1 - q0) * time1), n)
        if distance < thickness:
            x[i] = x[i] + n * (thickness - distance)
            slip = (x[i] - previous[i]) - (q1 - q0) * (time1 - time0)
            x[i] = x[i] - (slip - n * wp.dot(slip, n)) * friction


@wp.kernel
def update_velocity(
    x: wp.array(dtype=wp.vec3),
    previous: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    dt: float,
    max_speed: float,
):
    """Computes velocities from the positions before and after a time dt, no faster than `max_speed`."""
    i = wp.tid()
    w = (x[i] - previous[i]) / dt
    v[i] = w * wp.min(1.0, max_speed / wp.max(wp.length(w), 1.0e-9))


@wp.kernel
def pull_to_targets(
    x: wp.array(dtype=wp.vec3),
    index: wp.array(dtype=int),
    weight: wp.array(dtype=float),
    target: wp.array(dtype=wp.vec3),
):
    """Moves the vertices `index` toward their targets; a weight of 1 takes them there."""
    k = wp.tid()
    i = index[k]
    x[i] = x[i] + (target[k] - x[i]) * weight[k]


@wp.kernel
def find_self_contacts(
    grid: wp.uint64,
    x: wp.array(dtype=wp.vec3),
    rest_shape: wp.array(dtype=wp.vec3),
    radius: float,
    partners: wp.array(dtype=int),
    max_partners: int,
):
    """Finds for each vertex the vertices within `radius` that are far from it on the rest shape; -1 fills the rest."""
    i = wp.tid()
    query = wp.hash_grid_query(grid, x[i], radius)
    j = wp.int32(0)
    count = wp.int32(0)
    for k in range(max_partners):
        partners[i * max_partners + k] = -1
    while wp.hash_grid_query_next(query, j):
        if j != i and count < max_partners:
            if wp.length(x[i] - x[j]) < radius and wp.length(rest_shape[i] - rest_shape[j]) > 2.0 * radius:
                partners[i * max_partners + count] = j
                count += 1


@wp.kernel
def resolve_self_contacts(
    x: wp.array(dtype=wp.vec3),
    resolved: wp.array(dtype=wp.vec3),
    partners: wp.array(dtype=int),
    max_partners: int,
    gap: float,
):
    """Writes to `resolved` the positions x with the partners of `find_self_contacts` at least `gap` apart."""
    i = wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    count = wp.float32(0.0)
    for k in range(max_partners):
        j = partners[i * max_partners + k]
        if j >= 0:
            d = x[i] - x[j]
            length = wp.length(d)
            if length < gap and length > 1.0e-9:
                total = total + d * (0.5 * (gap - length) / length)
                count += 1.0
    resolved[i] = x[i] + total / wp.max(count, 1.0)


@wp.kernel
def cast_rays(
    mesh: wp.uint64,
    origin: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    face: wp.array(dtype=int),
    depth: wp.array(dtype=float),
):
    """Finds the first face that each ray hits within 10 m, -1 for none, and its distance."""
    i = wp.tid()
    hit = wp.mesh_query_ray(mesh, origin[i], direction[i], 10.0)
    face[i] = -1
    if hit.result:
        face[i] = hit.face
        depth[i] = hit.t


@wp.func
def crossing_depth(a0: wp.vec3, a1: wp.vec3, a2: wp.vec3, b0: wp.vec3, b1: wp.vec3, b2: wp.vec3) -> float:
    """Returns how far triangle a reaches to both sides of the plane of triangle b; negative if it does not cross it."""
    n = wp.normalize(wp.cross(b1 - b0, b2 - b0))
    s0 = wp.dot(a0 - b0, n)
    s1 = wp.dot(a1 - b0, n)
    s2 = wp.dot(a2 - b0, n)
    return wp.min(wp.max(s0, wp.max(s1, s2)), -wp.min(s0, wp.min(s1, s2)))


@wp.kernel
def find_intersections(
    mesh: wp.uint64,
    x: wp.array(dtype=wp.vec3),
    indices: wp.array(dtype=int),
    rest_centre: wp.array(dtype=wp.vec3),
    garment: wp.array(dtype=int),
    min_depth: float,
    min_rest_distance: float,
    intersects: wp.array(dtype=int),
):
    """Marks faces that reach deeper than `min_depth` through a face of another garment, or of their own.

    Faces of one garment closer than `min_rest_distance` on the rest shape count as neighbours and are not tested.
    """
    f = wp.tid()
    a0 = x[indices[3 * f]]
    a1 = x[indices[3 * f + 1]]
    a2 = x[indices[3 * f + 2]]
    query = wp.mesh_query_aabb(mesh, wp.min(a0, wp.min(a1, a2)), wp.max(a0, wp.max(a1, a2)))
    g = wp.int32(0)
    while wp.mesh_query_aabb_next(query, g):
        if garment[f] != garment[g] or wp.length(rest_centre[f] - rest_centre[g]) > min_rest_distance:
            b0 = x[indices[3 * g]]
            b1 = x[indices[3 * g + 1]]
            b2 = x[indices[3 * g + 2]]
            if (
                crossing_depth(a0, a1, a2, b0, b1, b2) > min_depth
                and crossing_depth(b0, b1, b2, a0, a1, a2) > min_depth
            ):
                if wp.intersect_tri_tri(a0, a1, a2, b0, b1, b2) != 0:
                    intersects[f] = 1
