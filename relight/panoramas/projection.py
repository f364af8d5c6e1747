"""Projects panoramas to spherical harmonics.

Radiance is constant over each pixel or, if samples lie on the corners, bilinear between them, and Y_lm is integrated
over the exact solid angles. A constant panorama of any size therefore has L00 = sqrt(4 pi) c and no other coefficients.
Directions are in the camera frame: +x right, +y up, +z toward the camera.
"""

from collections.abc import Callable

import numpy as np

from relight.panoramas.panorama import Panorama
from relight.sh import bands, basis, coefficient_count, order_of, rotate_y, rotation_matrix

# Faces of a cube seen from its centre: axis of the face, image right, image down.
CUBE_FACES = {
    "+x": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-x": ((-1, 0, 0), (0, 0, -1), (0, -1, 0)),
    "+y": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    "-y": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "+z": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),
    "-z": ((0, 0, -1), (1, 0, 0), (0, -1, 0)),
}
STRIP = ("+x", "-x", "+y", "-y", "+z", "-z")  # OpenEXR
# OpenGL, Direct3D and three.js are left-handed with +z forward, so their fifth face is at -z of the camera frame.
STRIP_GL = ("+x", "-x", "+y", "-y", "-z", "+z")
# Row and column of the faces of a cross; that of +z depends on the orientation.
CROSS = {"+y": (0, 1), "-x": (1, 0), "-z": (1, 1), "+x": (1, 2), "-y": (2, 1)}
LATLONG_FRAME = np.array([[0, 0, -1], [1, 0, 0], [0, 1, 0]])  # camera frame to (image centre, image right, image up)
MIRROR = np.diag([-1.0, 1.0, 1.0])

ToSphere = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def project(panorama: Panorama, order: int = 2) -> np.ndarray:
    """Projects a panorama to spherical harmonics.

    Args:
        panorama: of any layout.
        order: of the spherical harmonics.

    Returns:
        The light (K,3) float64: radiance coefficients, without A_l, in the camera frame.

    >>> white = Panorama(np.ones((4, 8, 3), np.float32))
    >>> project(white)[0].round(3).tolist()  # sqrt(4 pi)
    [3.545, 3.545, 3.545]
    """
    pixels, corners = panorama.pixels, panorama.corners
    match panorama.layout:
        case "latlong":
            light = _project_latlong(pixels, order, corners)
            if panorama.front == "+z":
                light = rotate_y(light, np.pi)
        case "angular":
            light = _project_plane(pixels, _angular_to_sphere, order, corners, disc=True)
        case "ball":
            light = _project_plane(pixels, _ball_to_sphere, order, corners, disc=True)
        case _:
            light = _project_cube(cut_faces(pixels, panorama.layout), order, corners)
    return orient(light, panorama.yaw, panorama.flip)


def orient(light: np.ndarray, yaw: float = 0.0, flip: bool = False) -> np.ndarray:
    """Mirrors a light (K,C) left to right if `flip`, then rotates it by `yaw` degrees, from +z toward +x."""
    if flip:
        light = rotation_matrix(MIRROR, order_of(len(light))) @ light
    return rotate_y(light, np.radians(yaw)) if yaw else light


def _gauss_legendre(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns Gauss-Legendre nodes (nodes,) and weights (nodes,) on [0,1]."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    return (x + 1) / 2, w / 2


def _profile_integrals(function: Callable[[np.ndarray], np.ndarray], samples: int, corners: bool) -> np.ndarray:
    """Returns the integrals (samples,K) over [0,1] of a function times the basis function of each sample in a line.

    The basis function is the box of a pixel or, if samples lie on the corners, the hat between the neighbours. Sixteen
    nodes per cell are exact to rounding for low orders, even with a single cell from pole to pole.
    """
    cells = samples - 1 if corners else samples
    x, w = _gauss_legendre(16)
    values = function(((np.arange(cells)[:, None] + x) / cells).ravel()).reshape(cells, len(x), -1) / cells
    if not corners:
        return np.einsum("cnk,n->ck", values, w)
    integrals = np.zeros((samples, values.shape[-1]))
    integrals[:-1] += np.einsum("cnk,n->ck", values, w * (1 - x))
    integrals[1:] += np.einsum("cnk,n->ck", values, w * x)
    return integrals


def _project_latlong(pixels: np.ndarray, order: int, corners: bool = False) -> np.ndarray:
    """Returns the coefficients (K,C) of a lat-long image (H,W,C), with -z at the centre and +x to the right.

    In the frame of the image's pole, Y_lm separates into a function of the row and cos or sin of m times the azimuth.
    The columns are therefore reduced to 2 order + 1 first; a fixed rotation then takes the pole to z.
    """
    height, width = pixels.shape[:2]

    def rows(t: np.ndarray) -> np.ndarray:
        """Returns Y_lm at azimuth 0 times the solid angle per unit of t, (T,K), for t from the top 0 to 1."""
        theta = np.pi * t
        meridian = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], -1)  # azimuth 0: cos m phi = 1
        return basis(meridian, order) * (np.pi * np.sin(theta))[:, None]

    def columns(t: np.ndarray) -> np.ndarray:
        """Returns cos and sin of m times the azimuth, times 2 pi, (T,2 order+1), for t from the left 0 to 1."""
        phi, m = 2 * np.pi * (t[:, None] - 0.5), np.arange(order + 1)
        return 2 * np.pi * np.concatenate([np.cos(m * phi), np.sin(m[1:] * phi)], -1)

    row, column = _profile_integrals(rows, height, corners), _profile_integrals(columns, width, corners)
    harmonic = np.empty((height, 2 * order + 1, pixels.shape[2]))
    for start in range(0, height, 64):  # in slices, since the product is in double precision
        part = pixels[start : start + 64]
        harmonic[start : start + 64] = np.einsum("hwc,wm->hmc", part, column, optimize=True)
    l = bands(order)
    m = np.arange(coefficient_count(order)) - l * l - l
    profile = row[:, l * l + l + abs(m)]
    coefficients = np.einsum("hk,hkc->kc", profile, harmonic[:, np.where(m < 0, order - m, m)])
    return rotation_matrix(LATLONG_FRAME.T, order) @ coefficients


def latlong_directions(height: int, width: int) -> np.ndarray:
    """Returns the directions (height,width,3) of the pixels' centres of a lat-long image with -z in its middle."""
    theta = (np.arange(height) + 0.5)[:, None] / height * np.pi
    phi = (2 * (np.arange(width) + 0.5) / width - 1) * np.pi
    sines = np.sin(theta)
    return np.stack(np.broadcast_arrays(sines * np.sin(phi), np.cos(theta), -sines * np.cos(phi)), -1)


def latlong_solid_angles(height: int, width: int) -> np.ndarray:
    """Returns the solid angle (height,) of a pixel in each row of a lat-long image; the sum over all pixels is 4 pi."""
    return -np.diff(np.cos(np.arange(height + 1) / height * np.pi)) * 2 * np.pi / width


def _project_plane(
    pixels: np.ndarray, to_sphere: ToSphere, order: int, corners: bool = False, disc: bool = False
) -> np.ndarray:
    """Returns the coefficients (K,C) of a square image (n,n,C), by Gauss-Legendre quadrature in each pixel.

    `to_sphere` maps (u,v) in [-1,1], u right and v down, to directions (...,3) and solid angle per area (...). With
    `corners`, the outermost samples lie on the edges of the image; with `disc`, and without `corners`, only the part of
    each pixel inside the unit circle counts.
    """
    n = pixels.shape[0]
    cells = n - 1 if corners else n
    nodes, node_weights = _gauss_legendre(int(np.clip(1024 // n, 2, 8)))
    edges = 2 * np.arange(cells + 1) / cells - 1
    rows = np.arcsin(edges) if disc else edges
    total = np.zeros((coefficient_count(order), pixels.shape[2]))
    step = max(1, 65536 // n)
    for start in range(0, cells, step):
        stop = min(start + step, cells)
        part = pixels[start : stop + 1 if corners else stop].astype(np.float64)
        height = np.diff(rows[start : stop + 1])[:, None]
        for node_v, weight_v in zip(nodes, node_weights):
            v = rows[start:stop, None] + node_v * height
            if disc:  # v = sin t, u = cos t sin s is regular at the rim, so pixels that it cuts are exact, too
                half_chord = np.cos(v)
                v = np.sin(v)
                columns = np.arcsin(np.clip(edges / half_chord, -1, 1))
            else:
                half_chord = 1.0
                columns = np.broadcast_to(edges, (len(v), cells + 1))
            width = np.diff(columns)
            for node_u, weight_u in zip(nodes, node_weights):
                u, area = columns[:, :-1] + node_u * width, weight_u * weight_v * width * height
                if disc:
                    u, area = half_chord * np.sin(u), area * half_chord**2 * np.cos(u)
                direction, density = to_sphere(u, v)
                radiance = part
                if corners:
                    radiance = part[:-1] * (1 - node_v) + part[1:] * node_v
                    radiance = radiance[:, :-1] * (1 - node_u) + radiance[:, 1:] * node_u
                weighted_basis = basis(direction, order) * (density * area)[..., None]
                total += np.tensordot(weighted_basis, radiance, axes=((0, 1), (0, 1)))
    return total


def _angular_to_sphere(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Maps an angular map (Debevec) to the sphere: -z is at the centre, the angle to -z is pi times the radius."""
    r = np.hypot(u, v)
    sinc = np.sinc(r)  # sin(pi r) / (pi r)
    return np.stack([np.pi * u * sinc, -np.pi * v * sinc, -np.cos(np.pi * r)], -1), np.pi**2 * sinc


def _ball_to_sphere(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Maps an orthographic photo of a mirror ball to the sphere: the centre reflects +z, the rim -z."""
    r2 = np.minimum(u * u + v * v, 1.0)
    forward = 2 * np.sqrt(1 - r2)  # reflection of +z about the normal (u, -v, sqrt(1 - r2))
    return np.stack([u * forward, -v * forward, 1 - 2 * r2], -1), np.full(r2.shape, 4.0)


def _face_to_sphere(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Maps the face of a cube at +z to the sphere, image right along +x and image down along -y."""
    u, v = np.broadcast_arrays(u, v)
    length = np.sqrt(1 + u * u + v * v)
    return np.stack([u, -v, np.ones_like(u)], -1) / length[..., None], length**-3


def cut_faces(pixels: np.ndarray, layout: str) -> dict[str, np.ndarray]:
    """Cuts a cross (3:4 or 4:3) or strip (1:6 or 6:1) into its six faces.

    Args:
        pixels: (H,W,C).
        layout: "cross", "strip" or "strip-gl".

    Returns:
        By the keys of CUBE_FACES, in any order, views (n,n,C) of `pixels`, oriented as there.
    """
    height, width = pixels.shape[:2]
    if layout == "cross":
        n = height // (4 if height > width else 3)
        places = {**CROSS, "+z": (3, 1) if height > width else (1, 3)}
    else:
        n = min(height, width)
        order = STRIP if layout == "strip" else STRIP_GL
        places = {face: (i, 0) if height > width else (0, i) for i, face in enumerate(order)}
    faces = {face: pixels[n * i : n * (i + 1), n * j : n * (j + 1)] for face, (i, j) in places.items()}
    if layout == "cross" and height > width:
        faces["+z"] = faces["+z"][::-1, ::-1]  # the lowest face of an upright cross is upside down
    return faces


def _project_cube(faces: dict[str, np.ndarray], order: int, corners: bool = False) -> np.ndarray:
    """Projects the faces of a cube, images (n,n,C) by the keys of CUBE_FACES: each as that at +z, then rotated."""
    channels = next(iter(faces.values())).shape[2]
    stacked = _project_plane(np.concatenate(list(faces.values()), -1), _face_to_sphere, order, corners)
    total = np.zeros((stacked.shape[0], channels))
    for i, face in enumerate(faces):
        axis, right, down = np.array(CUBE_FACES[face], float)
        rotation = np.stack([right, -down, axis], -1)
        total += rotation_matrix(rotation, order) @ stacked[:, channels * i : channels * (i + 1)]
    return total
