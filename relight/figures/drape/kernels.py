"""Warp kernels of the cloth solver: integration, distance constraints, contacts, pins, ray casts, intersections.

Arguments that mean the same in all of them, in metres and seconds:

x, previous: (n,3) vertices of the cloth, now and before the time step; v: (n,3) their velocities.
mesh: number of a `wp.Mesh`; indices: (3 F,) vertices of the faces.
face: (n,) the nearest face of the collider, -1 for none; barycentric: (n,2) weights of its first two corners there.
partners: (n * max_partners,) other vertices that each vertex may touch, -1 for none.
dt: the time step.
"""

import warp as wp

Points, Numbers, Indices = wp.array(dtype=wp.vec3), wp.array(dtype=float), wp.array(dtype=int)  # types of arguments
Pairs, Shares = wp.array(dtype=wp.vec2i), wp.array(dtype=wp.vec2)


@wp.kernel
def integrate(x: Points, v: Points, previous: Points, gravity: float, dt: float, damping: float):
    """Advances x by v, times `damping`, and by the acceleration `gravity` along y, over a step; sets `previous`."""
    i = wp.tid()
    previous[i] = x[i]
    x[i] = x[i] + v[i] * (dt * damping) + wp.vec3(0.0, gravity * dt * dt, 0.0)


@wp.kernel
def solve_distance_constraints(
    x: Points, pairs: Pairs, rest_length: Numbers, stiffness: Numbers, count: int, iterations: int
):
    """Solves all distance constraints in order, in one thread, since they share vertices (position-based dynamics).

    Args:
        x: updated.
        pairs: (C,2) the vertices of each constraint.
        rest_length: (C,).
        stiffness: (C,) share in [0,1] of the error that is removed at a time.
        count: C.
        iterations: how often all are solved.
    """
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
def find_nearest_faces(mesh: wp.uint64, x: Points, max_distance: float, face: Indices, barycentric: Shares):
    """Sets `face` and `barycentric` to those of a mesh that are nearest to points x, within `max_distance`."""
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, x[i], max_distance)
    face[i] = -1
    if query.result:
        face[i] = query.face
        barycentric[i] = wp.vec2(query.u, query.v)


@wp.kernel
def resolve_contacts(
    x: Points,
    previous: Points,
    face: Indices,
    barycentric: Shares,
    indices: Indices,
    start: Points,
    end: Points,
    normal: Points,
    time0: float,
    time1: float,
    thickness: float,
    friction: float,
    ground: float,
):
    """Keeps each vertex outside a moving collider, which drags it along by friction.

    A vertex below the ground returns to where it was, on the ground.

    Args:
        x: updated.
        previous, face, barycentric: as above.
        indices: of the collider.
        start, end: (V,3) the collider's vertices at the start and at the end of the frame.
        normal: (V,3) outward normals of the collider's vertices.
        time0, time1: start and end of the time step, in [0,1] of the frame.
        thickness: least distance from the collider.
        friction: share in [0,1] of the sliding that is removed.
        ground: height of the ground.
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
def update_velocity(x: Points, previous: Points, v: Points, dt: float, max_speed: float):
    """Sets v by the positions before and after a time step, at most `max_speed`."""
    i = wp.tid()
    w = (x[i] - previous[i]) / dt
    v[i] = w * wp.min(1.0, max_speed / wp.max(wp.length(w), 1.0e-9))


@wp.kernel
def pull_to_targets(x: Points, index: Indices, weight: Numbers, target: Points):
    """Moves the vertices `index` (m,) of x toward targets (m,3); a weight (m,) of 1 takes one there."""
    k = wp.tid()
    i = index[k]
    x[i] = x[i] + (target[k] - x[i]) * weight[k]


@wp.kernel
def find_self_contacts(
    grid: wp.uint64, x: Points, rest_shape: Points, radius: float, partners: Indices, max_partners: int
):
    """Finds for each vertex others that are near although they are far from it on the rest shape.

    Args:
        grid: number of a `wp.HashGrid` of x.
        x: as above.
        rest_shape: (n,3) the same on the pattern.
        radius: within which vertices are near; beyond twice of it they are far.
        partners: gets the vertices found for each.
        max_partners: most vertices that are found for one.
    """
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
def resolve_self_contacts(x: Points, resolved: Points, partners: Indices, max_partners: int, gap: float):
    """Moves each vertex half-way apart from its partners nearer than `gap`, by the mean of what each of them asks.

    `resolved` (n,3) gets the new positions.
    """
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
def cast_rays(mesh: wp.uint64, origin: Points, direction: Points, face: Indices, depth: Numbers):
    """Finds the first face that each of N rays hits: from an origin (N,3) in a unit direction (N,3).

    `face` (N,) gets it, -1 for none within 10 m, and `depth` (N,) its distance.
    """
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
    x: Points,
    indices: Indices,
    rest_centre: Points,
    garment: Indices,
    min_depth: float,
    min_rest_distance: float,
    intersects: Indices,
):
    """Marks faces that reach through a face of another garment, or of their own.

    Args:
        mesh, x, indices: of all garments.
        rest_centre: (F,3) centres of the faces on the rest shape.
        garment: (F,) number of the garment of each face.
        min_depth: that both faces must reach through the other.
        min_rest_distance: faces of one garment whose centres are closer on the rest shape are not tested.
        intersects: (F,) 0, gets 1 for such faces.
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
