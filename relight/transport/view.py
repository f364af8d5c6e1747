"""From where a figure is seen: turned about its vertical, from above or below, through a lens."""

from dataclasses import asdict, dataclass

import numpy as np

from relight.files import UserError
from relight.sh.rotation import about_y

FILM = 18.0  # half the height of the picture on film, mm: the long side of 36 x 24 mm, the camera held upright
NEAR = 0.05  # of the longer side of the figure's box: what comes closer to the eye is not seen well


@dataclass(frozen=True)
class View:
    """One view of an aligned figure; the default is the frontal one of the tables.

    yaw: degrees by which the figure is turned about its vertical, its front toward image right where positive;
    pitch: degrees by which the camera stands higher than the figure and looks down on it, lower where negative;
    focal: of the lens in mm on 36 mm of film over the height of the picture (the 35 mm equivalent of a camera held
    upright), None for orthographic. UserError on values out of range.
    """

    yaw: float = 0.0
    pitch: float = 0.0
    focal: float | None = None

    def __post_init__(self):
        if not -180 <= self.yaw <= 180:
            raise UserError(f"yaw {self.yaw}: a figure is turned by -180 to 180 degrees")
        if not -90 <= self.pitch <= 90:
            raise UserError(f"pitch {self.pitch}: a figure is seen from -90 degrees, straight below, to 90, above")
        if self.focal is not None and not 10 <= self.focal <= 10000:
            raise UserError(f"focal length {self.focal}: it is 10 to 10000 mm, or none for an orthographic camera")

    @property
    def rotation(self) -> np.ndarray:
        """The rotation (3, 3) from the mesh's axes to the camera's: the figure is turned, then the camera raised."""
        c, s = np.cos(np.radians(self.pitch)), np.sin(np.radians(self.pitch))
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ about_y(np.radians(self.yaw))

    @property
    def distance(self) -> float | None:
        """Of the eye from the plane z = 0 of the camera's frame, of which it sees [-1, 1]^2; None if orthographic."""
        return None if self.focal is None else self.focal / FILM


FRONTAL = View()


@dataclass(frozen=True)
class Pose:
    """Where a view puts the mesh before the camera: camera frame = scale * rotation @ (mesh frame - centre)."""

    rotation: np.ndarray  # (3, 3)
    centre: np.ndarray  # (3,)
    scale: float

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the mesh's frame in the camera's."""
        return self.scale * turned(self.rotation, points - self.centre)

    def to_mesh(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) of the camera's frame in the mesh's."""
        return turned(self.rotation.T, points) / self.scale + self.centre


def turned(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Each of `vectors` (N, 3) turned by `rotation` (3, 3); a BLAS rounds by its number of threads, this does not."""
    return np.einsum("jk,nk->nj", rotation, vectors)


def pose(view: View, vertices: np.ndarray) -> Pose:
    """Puts the `vertices` (V, 3) of a mesh before the camera.

    The box of the figure in the picture is centred, and its longer side is as long as that of the frontal view: a lens
    is not zoomed for that, the eye moves (perspective is a matter of distance). The middle of the figure's depth lies
    in the plane z = 0. UserError where the figure has no extent in the picture, and where the eye would touch it.
    """
    low, high = vertices.min(0), vertices.max(0)
    middle, side = (low + high) / 2, float((high - low)[:2].max())
    seen = turned(view.rotation, vertices - middle)
    low, high = seen.min(0), seen.max(0)
    extent = float((high - low)[:2].max())
    if not (side > 0 and extent > 0):
        raise UserError(f"the mesh has no extent, from the front or turned by {view.yaw:g} and {view.pitch:g} degrees")
    shift = (low + high) / 2
    scale = side / extent
    if view.focal is not None:
        eyes = [eye(axis, seen[:, 2], side / 2, view.distance) for axis in seen.T[:2]]
        away = max(eyes)
        if away - high[2] < NEAR * side:
            raise UserError(f"focal length {view.focal:g}: the eye would touch the figure; give a longer one")
        shift[:2] = [beside(axis, seen[:, 2], view.distance, away) for axis in seen.T[:2]]
        scale = view.distance / (away - shift[2])
    return Pose(view.rotation, middle + view.rotation.T @ shift, float(scale))


def sides(across: np.ndarray, depth: np.ndarray, half: float, distance: float) -> tuple[int, int]:
    """Which points touch the right and the left side of the pyramid of all that the eye sees within +-half.

    The point (x, z), seen from an eye at (t, a), is at distance * (x - t) / (a - z) in the picture, and that is within
    +-half where distance x + half z <= half a + distance t, and half z - distance x <= half a - distance t.
    """
    return int((half * depth + distance * across).argmax()), int((half * depth - distance * across).argmax())


def eye(across: np.ndarray, depth: np.ndarray, half: float, distance: float) -> float:
    """The place a on the z axis from which points at x = `across`, z = `depth` (V,) just fill +-half, well centred."""
    right, left = sides(across, depth, half, distance)
    return float(depth[right] + depth[left] + distance / half * (across[right] - across[left])) / 2


def beside(across: np.ndarray, depth: np.ndarray, distance: float, away: float) -> float:
    """The place t beside the z axis from which an eye at z = `away` sees the points centred.

    It looks for the half-width that they fill. That is the root of a convex, piecewise linear function, so that
    Newton's steps from 0 never pass it and end in it.
    """
    half, grown = 0.0, True
    while grown:
        right, left = sides(across, depth, half, distance)
        step = distance * float(across[right] - across[left]) / float(2 * away - depth[right] - depth[left])
        grown = step > half * (1 + 1e-12)
        half = max(half, step)
    return float(across[right] + across[left] + half / distance * (depth[right] - depth[left])) / 2


def record(view: View, pose: Pose) -> dict:
    """What a header says of a view, in plain values."""
    return {
        **asdict(view),
        "rotation": pose.rotation.round(9).tolist(),
        "centre": pose.centre.round(9).tolist(),
        "scale": round(pose.scale, 9),
    }


def view_names(figure: str, views: int) -> list[str]:
    """Names of the maps of a figure's further views."""
    return [f"{figure}.v{number}" for number in range(1, views + 1)]


def outfit_names(figure: str, outfits: int) -> list[str]:
    """Names of the maps of a figure in each of its outfits: in its own it is called like the figure."""
    return [figure, *(f"{figure}.o{number}" for number in range(1, outfits))]


def random_view(name: str, seed: int) -> View:
    """The view called `name`, as photographs of people are taken: the same whatever other views there are.

    yaw: three in four from N(0, 30 degrees), one in four from all round; pitch: N(0, 6 degrees) within +-15; one in
    four orthographic, the others with a focal length of 25 to 120 mm, uniform in its logarithm.
    """
    rng = np.random.default_rng([seed, *name.encode()])
    yaw = rng.normal(0, 30) if rng.random() < 0.75 else rng.uniform(-180, 180)
    pitch = np.clip(rng.normal(0, 6), -15, 15)
    focal = None if rng.random() < 0.25 else round(25 * (120 / 25) ** rng.random(), 1)
    return View(round(float(yaw), 2), round(float(pitch), 2), focal)
