"""Views of a figure: rotated about its vertical, from above or below, through a lens."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.numbers import finite
from relight.sh import rotation_about_y

HALF_FILM_HEIGHT = 18.0  # mm, for 36 x 24 mm film in portrait format
MIN_EYE_DISTANCE = 0.05  # from the figure, over the longer side of the figure's box


@dataclass(frozen=True)
class View:
    """A view of an aligned figure; the default is the frontal one of the tables.

    Attributes:
        yaw: degrees by which the figure is rotated about its vertical, its front toward image right where positive.
        pitch: degrees by which the camera is raised and looks down; negative: lowered, looking up.
        focal: focal length in mm for 36 mm of film over the height of the image (the 35 mm equivalent in portrait
            format); None for an orthographic camera.

    Raises:
        UserError: if an angle or the focal length is out of range.
    """

    yaw: float = 0.0
    pitch: float = 0.0
    focal: float | None = None

    def __post_init__(self) -> None:
        finite("yaw", self.yaw, -180, 180)
        finite("pitch", self.pitch, -90, 90)
        if self.focal is not None:
            finite("focal", self.focal, 10, 10000)

    @property
    def rotation(self) -> np.ndarray:
        """The rotation (3,3) from the mesh's axes to the camera's: first by yaw, then by pitch."""
        c, s = np.cos(np.radians(self.pitch)), np.sin(np.radians(self.pitch))
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ rotation_about_y(np.radians(self.yaw))

    @property
    def distance(self) -> float | None:
        """The eye's distance from the plane z = 0, where it sees the square [-1,1]^2; None if orthographic."""
        return None if self.focal is None else self.focal / HALF_FILM_HEIGHT


FRONTAL = View()


@dataclass(frozen=True)
class Pose:
    """The similarity from the mesh's frame to the camera's: scale * rotation @ (point - centre).

    Attributes:
        rotation: (3,3).
        centre: (3,) in the mesh's frame.
        scale: positive.
    """

    rotation: np.ndarray
    centre: np.ndarray
    scale: float

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """Transforms points (N,3) from the mesh's frame to the camera's."""
        return self.scale * rotate_vectors(self.rotation, points - self.centre)

    def to_mesh(self, points: np.ndarray) -> np.ndarray:
        """Transforms points (N,3) from the camera's frame to the mesh's."""
        return rotate_vectors(self.rotation.T, points) / self.scale + self.centre


def rotate_vectors(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Rotates vectors (N,3) by a rotation (3,3); unlike BLAS, it rounds equally for any number of threads."""
    return np.einsum("jk,nk->nj", rotation, vectors)


def place_mesh(view: View, vertices: np.ndarray) -> Pose:
    """Returns the pose in which a mesh stands in front of the camera of a view.

    The figure's bounding box in the image is centred, and its longer side is as long as in the frontal view. To achieve
    this, the eye moves; the focal length stays. The middle of the figure's depth lies in the plane z = 0.

    Args:
        view: view of the mesh.
        vertices: (V,3) float64 of the mesh.

    Returns:
        The pose of the mesh in the camera's frame.

    Raises:
        UserError: if the figure has no extent in the image, or if the eye would touch it.
    """
    low, high = vertices.min(0), vertices.max(0)
    mesh_centre, side = (low + high) / 2, float((high - low)[:2].max())
    points = rotate_vectors(view.rotation, vertices - mesh_centre)
    low, high = points.min(0), points.max(0)
    extent = float((high - low)[:2].max())
    if not (side > 0 and extent > 0):
        raise UserError(f"the mesh has no extent, from the front or turned by {view.yaw:g} and {view.pitch:g} degrees")
    shift = (low + high) / 2
    scale = side / extent
    if (distance := view.distance) is not None:
        x, y, depth = points.T  # across and down are independent: in each, the eye sees points (x, z) or (y, z)
        eye_z = max(
            _edge_crossing(depth, lateral, 2 * distance / side, *_extreme_points(lateral, depth, side / 2, distance))
            for lateral in (x, y)
        )
        if eye_z - high[2] < MIN_EYE_DISTANCE * side:
            raise UserError(f"focal length {view.focal:g}: the eye would touch the figure; choose a longer one")
        shift[:2] = [_eye_offset(lateral, depth, distance, eye_z) for lateral in (x, y)]
        scale = distance / (eye_z - shift[2])
    return Pose(view.rotation, mesh_centre + view.rotation.T @ shift, float(scale))


def _extreme_points(lateral: np.ndarray, depth: np.ndarray, half_width: float, distance: float) -> tuple[int, int]:
    """Finds the points that limit how close an eye can be, if the image shows all points within +-half_width.

    An eye at (t, a) sees a point (x, z), `lateral` and `depth`, at distance * (x - t) / (a - z) of its image plane.
    With h = half_width, the point is within +-h if distance x + h z <= h a + distance t (right side) and h z - distance
    x <= h a - distance t (left side). Each inequality is tightest at the point with the largest left-hand side,
    wherever the eye is. Returns the indices of the points that limit the right and the left side.
    """
    right, left = ((half_width * depth + sign * distance * lateral).argmax() for sign in (1, -1))
    return int(right), int(left)


def _eye_offset(lateral: np.ndarray, depth: np.ndarray, distance: float, eye_z: float) -> float:
    """Returns the eye's x, or y, at z = `eye_z` from which the points are centred in the image.

    The half width that the points fill is the root of a convex, piecewise linear function. Newton's iterations from 0
    therefore converge without overshooting, in a finite number of steps.
    """
    half_width, is_growing = 0.0, True
    while is_growing:
        right, left = _extreme_points(lateral, depth, half_width, distance)
        step = distance * float(lateral[right] - lateral[left]) / float(2 * eye_z - depth[right] - depth[left])
        is_growing = step > half_width * (1 + 1e-12)
        half_width = max(half_width, step)
    return _edge_crossing(lateral, depth, half_width / distance, right, left)


def _edge_crossing(along: np.ndarray, across: np.ndarray, slope: float, right: int, left: int) -> float:
    """Returns the coordinate `along` of the eye at which the lines of sight through the two outermost points meet.

    A line of sight changes it by `slope` per unit of the coordinate `across`.
    """
    return float(along[right] + along[left] + slope * (across[right] - across[left])) / 2


def view_record(view: View, pose: Pose) -> dict[str, Any]:
    """Returns the attributes of a view and of the mesh's pose as plain values by name, for the header of maps."""
    rotation, centre = (array.round(9).tolist() for array in (pose.rotation, pose.centre))
    return {**asdict(view), "rotation": rotation, "centre": centre, "scale": round(pose.scale, 9)}


def view_names(figure: str, views: int) -> list[str]:
    """Returns the names of the maps of a figure's further views.

    >>> view_names("g0012", 2)
    ['g0012.v1', 'g0012.v2']
    """
    return [f"{figure}.v{number}" for number in range(1, views + 1)]


def outfit_names(figure: str, outfits: int) -> list[str]:
    """Returns the names of the maps of a figure's frontal view in each outfit, its own first.

    >>> outfit_names("g0012", 3)
    ['g0012', 'g0012.o1', 'g0012.o2']
    """
    return [figure, *(f"{figure}.o{number}" for number in range(1, outfits))]


def random_view(name: str) -> View:
    """Draws a view that is typical of photographs of people; it depends on the name only.

    Yaw is from N(0, 30 degrees) with probability .75, else uniform. Pitch is from N(0, 6 degrees), clipped to +-15. One
    view in four is orthographic; the focal length of the others is log-uniform from 25 to 120 mm.

    Args:
        name: name of the view's maps.
    """
    rng = np.random.default_rng([0, *name.encode()])
    yaw = rng.normal(0, 30) if rng.random() < 0.75 else rng.uniform(-180, 180)
    pitch = np.clip(rng.normal(0, 6), -15, 15)
    focal = None if rng.random() < 0.25 else round(25 * (120 / 25) ** rng.random(), 1)
    return View(round(float(yaw), 2), round(float(pitch), 2), focal)
