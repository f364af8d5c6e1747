"""A twin of HumanOLAT's layout: a ball over a slab, drawn from formulas, under the lamps of a small light stage.

No mesh, ray caster or spherical harmonics take part in the frames: surface, shadows and shading have closed forms. The
mesh that lies beside them is what a reconstruction would be.
"""

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
CAMERAS = 4


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


def schedule(count: int) -> dict[int, int]:
    """Which lamp (or -1, all of them) each frame from 14 on shows, written out by hand."""
    shown, lamp = {14: -1}, 0
    number = 15
    for length in [19] + [20] * count:
        for _ in range(length):
            if lamp == count:
                return shown
            shown[number] = lamp
            lamp, number = lamp + 1, number + 1
        shown[number] = -1
        number += 1
    return shown


def write(
    folder: Path, cameras=(1,), count: int = 331, suffix: str = ".png", inverse: bool = False, who: str = "T001"
) -> Path:
    """Writes one subject's pose; returns the folder of the data set."""
    subject = folder / f"SUBJECT_{who}"
    pose, shared = subject / "POSE_00", subject / "shared"
    shared.mkdir(parents=True)
    positions = lamps(count)
    order = np.random.default_rng(5).permutation(count)  # the lamp that is lit at each step
    (shared / "LSX_light_positions_aligned.pc").write_text(
        "# lamps\n" + "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in positions / 1000)
    )
    (shared / "LSX3_light_z_spiral.txt").write_text("".join(f"{lamp + 1}\n" for lamp in order))
    text = "tc camera calibration v0.3\n"
    for number in range(CAMERAS):
        extrinsic, intrinsic = camera(number)
        if inverse:
            turn = extrinsic[:, :3].T
            extrinsic = np.concatenate([turn, -turn @ extrinsic[:, 3:]], 1)
        text += f"camera\t{number}\tCamera_{number + 1}\n\tframe\t0\n\t\tsensorSize 10 13.3 # in mm\n"
        for what, rows in (("extrinsics", extrinsic), ("intrinsics", intrinsic)):
            text += f"#    {what}\n" + "".join("#\t\t" + "\t".join(f"{x:.8f}" for x in row) + "\n" for row in rows)
        text += "\t\torientation 3\n"
    (shared / "cameras.calib").write_text(text)
    for number in cameras:
        seen = surface(number - 1)
        place = pose / "images_processed" / f"Cam{number:02d}"
        masks = pose / "segmentations" / "masks" / "000"
        for one in (place, masks):
            one.mkdir(parents=True, exist_ok=True)
        Image.fromarray(to_bytes(seen["mask"].astype(float))).save(masks / f"Cam{number:02d}.png")
        full = to_bytes(encode(2 * seen["albedo"]))
        more = {"quality": 99, "subsampling": "4:4:4", "speed": 10} if suffix == ".avif" else {}
        frames = {number: full for number in range(14)}
        for frame, lamp in schedule(count).items():
            frames[frame] = full if lamp < 0 else to_bytes(encode(lit(seen, positions[order[lamp]])))
        for frame, pixels in frames.items():
            Image.fromarray(pixels).save(place / f"{who}_A.{frame:06d}{suffix}", **more)
    mesh(pose / "model" / "model.obj")
    return folder


def mesh(path: Path) -> None:
    """Ball and slab as triangles."""
    ball = trimesh.creation.icosphere(5, RADIUS)
    ball.apply_translation(BALL)
    slab = trimesh.creation.box(2 * SLAB)
    slab.apply_translation([0, TOP - SLAB[1], 0])
    slab.unmerge_vertices()  # sharp edges
    path.parent.mkdir(parents=True)
    parts, text, first = (ball, slab), "", 1
    for part in parts:
        text += "".join(f"v {x:.5f} {y:.5f} {z:.5f}\n" for x, y, z in part.vertices)
        text += "".join(f"f {a + first} {b + first} {c + first}\n" for a, b, c in part.faces)
        first += len(part.vertices)
    path.write_text(text)
