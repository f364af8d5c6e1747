"""Views of a figure: rotated about its vertical, from above or below, through a lens."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from relight.files import UserError
from relight.sh import rotation_about_y

FILM = 18.0  # half the height of the image on film, mm: the long side of 36 x 24 mm, the camera held upright
NEAR = 0.05  # least distance of the figure from the eye, over the longer side of the figure's box


@dataclass(frozen=True)
class View:
    """A view of an aligned figure; the default is the frontal one of the tables.

    Attributes:
        yaw: degrees by which the figure is rotated about its vertical, its front toward image right where positive.
        pitch: degrees by which the camera is above the figure and looks down, below where negative.
        focal: focal length in mm for 36 mm of film over the height of the image (the 35 mm equivalent of a camera held
            upright); None for an orthographic camera.

    Raises:
        UserError: if an angle or the focal length is out of range.
    """

    yaw: float = 0.0
    pitch: float = 0.0
    focal: float | None = None

    def __post_init__(self) -> None:
        if not -180 <= self.yaw <= 180:
            raise UserError(f"yaw {self.yaw}: a figure is turned by -180 to 180 degrees")
        if not -90 <= self.pitch <= 90:
            raise UserError(f"pitch {self.pitch}: a figure is seen from -90 degrees, straight below, to 90, above")
        if self.focal is not None and not 10 <= self.focal <= 10000:
            raise UserError(f"focal length {self.focal}: it is 10 to 10000 mm, or none for an orthographic camera")

    @property
    def rotation(self) -> np.ndarray:
        """The rotation (3,3) from the mesh's axes to the camera's: first by yaw, then by pitch."""
        c, s = np.cos(np.radians(self.pitch)), np.sin(np.radians(self.pitch))
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ rotation_about_y(np.radians(self.yaw))

    @property
    def distance(self) -> float | None:
        """The eye's distance from the plane z = 0, where it sees the square [-1,1]^2; None if orthographic."""
        return None if self.focal is None else self.focal / FILM


FRONTAL = View()


@dataclass(frozen=True)
class Pose:
    """The similarity from the mesh's frame to the camera's: scale * rotation @ (point - centre).

    Attributes:
        rotation: (3,3).
        centre: (3,), of the mesh's frame.
        scale: positive.
    """

    rotation: np.ndarray
    centre: np.ndarray
    scale: float

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """Transforms points (N,3) from the mesh's frame to the camera's."""
        return self.scale * rotated(self.rotation, points - self.centre)

    def to_mesh(self, points: np.ndarray) -> np.ndarray:
        """Transforms points (N,3) from the camera's frame to the mesh's."""
        return rotated(self.rotation.T, points) / self.scale + self.centre


def rotated(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Rotates vectors (N,3) by a rotation (3,3); unlike BLAS, with the same rounding for any number of threads."""
    return np.einsum("jk,nk->nj", rotation, vectors)


def place(view: View, vertices: np.ndarray) -> Pose:
    """Places a mesh before the camera.

    The figure's box in the image is centred, and its longer side is as long as in the frontal view. For that the eye
    moves and the focal length stays. The middle of the figure's depth lies in the plane z = 0.

    Args:
        view: of the mesh.
        vertices: (V,3) float64 of the mesh.

    Raises:
        UserError: if the figure has no extent in the image, or if the eye would touch it.
    """
    low, high = vertices.min(0), vertices.max(0)
    middle, side = (low + high) / 2, float((high - low)[:2].max())
    points = rotated(view.rotation, vertices - middle)
    low, high = points.min(0), points.max(0)
    extent = float((high - low)[:2].max())
    if not (side > 0 and extent > 0):
        raise UserError(f"the mesh has no extent, from the front or turned by {view.yaw:g} and {view.pitch:g} degrees")
    shift = (low + high) / 2
    scale = side / extent
    if (distance := view.distance) is not None:
        away = max(eye_distance(axis, points[:, 2], side / 2, distance) for axis in points.T[:2])
        if away - high[2] < NEAR * side:
            raise UserError(f"focal length {view.focal:g}: the eye would touch the figure; give a longer one")
        shift[:2] = [eye_offset(axis, points[:, 2], distance, away) for axis in points.T[:2]]
        scale = distance / (away - shift[2])
    return Pose(view.rotation, middle + view.rotation.T @ shift, float(scale))


def extreme_points(across: np.ndarray, depth: np.ndarray, half: float, distance: float) -> tuple[int, int]:
    """Finds the points that limit how close an eye can be, if all points are to be within +-half in its image.

    A point (x, z) is at distance * (x - t) / (a - z) in the image of an eye at (t, a). It is within +-half if
    distance x + half z <= half a + distance t (the right side) and half z - distance x <= half a - distance t (the
    left one). Each inequality is tightest at the point where its left-hand side is largest, wherever the eye is.

    Args:
        across: (V,) x, or y, of the points.
        depth: (V,) z of the points.
        half: half of the width in the image.
        distance: from the eye to its image plane.

    Returns:
        Indices of the point that limits the right side, and of the one that limits the left side.
    """
    return int((half * depth + distance * across).argmax()), int((half * depth - distance * across).argmax())


def eye_distance(across: np.ndarray, depth: np.ndarray, half: float, distance: float) -> float:
    """Returns the eye's z from which points fill +-half of the image, centred; arguments as of `extreme_points`."""
    right, left = extreme_points(across, depth, half, distance)
    return float(depth[right] + depth[left] + distance / half * (across[right] - across[left])) / 2


def eye_offset(across: np.ndarray, depth: np.ndarray, distance: float, away: float) -> float:
    """Returns the eye's x, or y, at z = `away` from which the points are centred in the image.

    Solves for the half-width that the points fill. It is the root of a convex, piecewise linear function, so Newton's
    iterations from 0 never overshoot, and end.
    """
    half, grows = 0.0, True
    while grows:
        right, left = extreme_points(across, depth, half, distance)
        step = distance * float(across[right] - across[left]) / float(2 * away - depth[right] - depth[left])
        grows = step > half * (1 + 1e-12)
        half = max(half, step)
    return float(across[right] + across[left] + half / distance * (depth[right] - depth[left])) / 2


def view_record(view: View, pose: Pose) -> dict[str, Any]:
    """Returns the record of a view in the header of maps, as plain values."""
    return {
        **asdict(view),
        "rotation": pose.rotation.round(9).tolist(),
        "centre": pose.centre.round(9).tolist(),
        "scale": round(pose.scale, 9),
    }


def view_names(figure: str, views: int) -> list[str]:
    """Returns the names of the maps of a figure's further views.

    >>> view_names("g0012", 2)
    ['g0012.v1', 'g0012.v2']
    """
    return [f"{figure}.v{number}" for number in range(1, views + 1)]


def outfit_names(figure: str, outfits: int) -> list[str]:
    """Returns the names of the maps of a figure's frontal view in each of its outfits, its own first.

    >>> outfit_names("g0012", 3)
    ['g0012', 'g0012.o1', 'g0012.o2']
    """
    return [figure, *(f"{figure}.o{number}" for number in range(1, outfits))]


def random_view(name: str, seed: int) -> View:
    """Draws a view as photographs of people have; it depends on name and seed alone.

    Yaw: three in four from N(0, 30 degrees), one in four uniform; pitch: N(0, 6 degrees), clipped to +-15; one in four
    orthographic, the others with a focal length of 25 to 120 mm, uniform in its logarithm.

    Args:
        name: of the view's maps.
        seed: of all views.
    """
    rng = np.random.default_rng([seed, *name.encode()])
    yaw = rng.normal(0, 30) if rng.random() < 0.75 else rng.uniform(-180, 180)
    pitch = np.clip(rng.normal(0, 6), -15, 15)
    focal = None if rng.random() < 0.25 else round(25 * (120 / 25) ** rng.random(), 1)
    return View(round(float(yaw), 2), round(float(pitch), 2), focal)
