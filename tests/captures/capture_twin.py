"""A capture in closed form: a ball over a slab, drawn from formulas, under the lamps of a small light stage.

No mesh, ray caster or spherical harmonics take part in the frames: surface, shadows and shading have closed forms. The
mesh that lies beside them is what a reconstruction would be.
"""

import json
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from relight.srgb import encode, to_bytes

HEIGHT, WIDTH = 64, 48
BALL, RADIUS = np.array([0.0, 150.0, 0.0]), 320.0  # millimetres
SLAB = np.array([600.0, 30.0, 450.0])  # half sizes
TOP = -300.0  # of the slab
STAGE, MIDDLE = 2500.0, np.array([40.0, 0.0, -60.0])
POWER = 0.6  # k of the frames; no pixel of them reaches code 255


def lamps(count: int = 331) -> np.ndarray:
    """Positions (L,3) all round, in millimetres, from top to bottom."""
    index = np.arange(count) + 0.5
    y, angle = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    around = np.sqrt(1 - y * y)
    return MIDDLE + STAGE * np.stack([around * np.cos(angle), y, around * np.sin(angle)], -1)


def camera(number: int) -> tuple[np.ndarray, np.ndarray]:
    """The extrinsics (3,4), OpenCV's axes, and intrinsics (3,3) over the width of one of four cameras around."""
    angle = np.pi / 2 * number + 0.3
    eye = MIDDLE + 2300 * np.array([np.sin(angle), 0.25, np.cos(angle)])
    forward = (MIDDLE - eye) / np.linalg.norm(MIDDLE - eye)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    intrinsic = np.array([[1.6, 0, 0.51], [0, 1.61, 0.66], [0, 0, 1]])
    return np.concatenate([rotation, -rotation @ eye[:, None]], 1), intrinsic


def surface(number: int) -> dict[str, np.ndarray]:
    """What a camera sees: point, normal (H,W,3), albedo (H,W,3), mask (H,W), world's axes."""
    extrinsic, intrinsic = camera(number)
    rotation, eye = extrinsic[:, :3], -extrinsic[:, :3].T @ extrinsic[:, 3]
    row, column = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    pixels = np.stack([column, row, np.full_like(row, WIDTH)], -1) / WIDTH
    toward = pixels @ np.linalg.inv(intrinsic).T @ rotation
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    half = toward @ (eye - BALL)
    root = half**2 - ((eye - BALL) ** 2).sum() + RADIUS**2
    near = np.where(root > 0, -half - np.sqrt(np.maximum(root, 0)), np.inf)
    slab, side = box_entry(np.broadcast_to(eye, toward.shape), toward)
    distance = np.minimum(near, slab)
    mask = np.isfinite(distance)
    point = eye + np.where(mask, distance, 0)[..., None] * toward
    ball = mask & (near < slab)
    normal = np.where(ball[..., None], (point - BALL) / RADIUS, side) * mask[..., None]
    stripes = 0.5 + 0.3 * np.sign(np.sin(point[..., 1] / 40))
    albedo = np.where(ball[..., None], stripes[..., None] * [1.0, 0.8, 0.6], [0.5, 0.55, 0.6]) * mask[..., None]
    return {"point": point, "normal": normal, "albedo": albedo, "mask": mask, "ball": ball}


def box_entry(start: np.ndarray, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance at which rays enter the slab, inf where they do not, and the normal there."""
    middle = np.array([0, TOP - SLAB[1], 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = ((middle + np.array([-SLAB, SLAB])[:, *[None] * (start.ndim - 1)]) - start) / toward
    entry, leave = ends.min(0), ends.max(0)
    first, last = entry.max(-1), leave.min(-1)
    axis = np.eye(3)[entry.argmax(-1)]
    return np.where((first < last) & (first > 1e-6), first, np.inf), -np.sign(toward) * axis


def visible(point: np.ndarray, normal: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Whether nothing is along directions (...,3) from points just off the surface."""
    start = point + 1e-3 * normal
    half = ((start - BALL) * toward).sum(-1)
    root = half**2 - ((start - BALL) ** 2).sum(-1) + RADIUS**2
    ball = (root > 0) & (-half + np.sqrt(np.maximum(root, 0)) > 1e-2) & (half < 0)
    return ~ball & ~np.isfinite(box_entry(start, toward)[0])


def lit(seen: dict[str, np.ndarray], lamp: np.ndarray) -> np.ndarray:
    """The frame (H,W,3), linear, of a lamp at a position (3,)."""
    point, normal, albedo = (seen[name][seen["mask"]] for name in ("point", "normal", "albedo"))
    toward = lamp - point
    distance = np.linalg.norm(toward, axis=-1, keepdims=True)
    toward /= distance
    cosine = np.maximum((normal * toward).sum(-1), 0) * visible(point, normal, toward)
    frame = np.zeros_like(seen["albedo"])
    frame[seen["mask"]] = POWER * albedo * cosine[:, None] * (STAGE / distance) ** 2
    return frame


def write_capture(folder: Path, name: str, camera_number: int, lamp_count: int = 331) -> Path:
    """Writes a capture into folder/name; returns `folder`."""
    place, seen, positions = folder / name, surface(camera_number), lamps(lamp_count)
    (place / "frames").mkdir(parents=True)
    extrinsics, intrinsics = camera(camera_number)
    order = np.random.default_rng(5).permutation(lamp_count)  # frames are in no order of the lamps
    entries = []
    for frame, lamp in enumerate(order):
        Image.fromarray(to_bytes(encode(lit(seen, positions[lamp])))).save(place / "frames" / f"{frame:03d}.png")
        entries.append({"frame": f"frames/{frame:03d}.png", "position": positions[lamp].tolist()})
    matrices = {"intrinsics": (np.diag([WIDTH, WIDTH, 1]) @ intrinsics).tolist(), "extrinsics": extrinsics.tolist()}
    (place / "capture.json").write_text(json.dumps({"camera": matrices, "lamps": entries}))
    Image.fromarray(to_bytes(seen["mask"].astype(float))).save(place / "mask.png")
    mesh(place / "mesh.obj")
    return folder


def mesh(path: Path) -> None:
    """Ball and slab as triangles."""
    ball = trimesh.creation.icosphere(5, RADIUS)
    ball.apply_translation(BALL)
    slab = trimesh.creation.box(2 * SLAB)
    slab.apply_translation([0, TOP - SLAB[1], 0])
    slab.unmerge_vertices()  # sharp edges
    parts, text, first = (ball, slab), "", 1
    for part in parts:
        text += "".join(f"v {x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in part.vertices)
        text += "".join(f"f {a + first} {b + first} {c + first}\n" for a, b, c in part.faces)
        first += len(part.vertices)
    path.write_text(text)
