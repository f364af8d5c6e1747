"""Three meshes like a small folder of scans: one textured .obj, one .ply with vertex colors, one .glb."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image


def person(seed: int) -> trimesh.Trimesh:
    """A person of capsules, 1.7 m high, y up, facing +z: head with a nose, torso, arms, legs and feet."""
    rng = np.random.default_rng(seed)
    spread, width = rng.uniform(0.15, 0.3), rng.uniform(0.14, 0.18)
    parts = [capsule((0, 0.95, 0), (0, 1.35, 0), width), capsule((0, 1.55, 0), (0, 1.6, 0), 0.1)]
    parts.append(capsule((0, 1.57, 0.09), (0, 1.55, 0.12), 0.02))
    for side in (-1, 1):
        parts.append(capsule((side * 0.17, 1.38, 0), (side * (0.17 + spread), 0.9, 0.03), 0.05))
        parts.append(capsule((side * 0.09, 0.9, 0), (side * 0.12, 0.1, 0), 0.08))
        parts.append(capsule((side * 0.12, 0.05, 0), (side * 0.13, 0.05, 0.16), 0.05))
    return trimesh.util.concatenate(parts)


def capsule(start, end, radius: float) -> trimesh.Trimesh:
    start, end = np.array(start, float), np.array(end, float)
    axis = end - start
    mesh = trimesh.creation.capsule(height=float(np.linalg.norm(axis)), radius=radius, count=[24, 24])
    mesh.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], axis / np.linalg.norm(axis)))
    mesh.apply_translation((start + end) / 2 - mesh.bounds.mean(0))
    return mesh


def write_people(folder: Path) -> None:
    """The three files, and the texture and material of the .obj beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    textured, colored, plain = (person(seed) for seed in range(3))
    stripes = np.full((64, 64, 3), (200, 60, 40), np.uint8)
    stripes[::8] = (240, 240, 230)
    uv = (textured.vertices[:, :2] - textured.vertices[:, :2].min(0)) / np.ptp(textured.vertices[:, :2], axis=0)
    textured.visual = trimesh.visual.TextureVisuals(uv, image=Image.fromarray(stripes))
    textured.export(folder / "textured.obj")
    colors = rng.integers(60, 220, 3) * np.ones((len(colored.vertices), 1))
    colors[colored.vertices[:, 1] < 0.9] = (40, 50, 90)
    colored.visual = trimesh.visual.ColorVisuals(colored, vertex_colors=colors.astype(np.uint8))
    colored.export(folder / "colored.ply")
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[90, 140, 80, 255])
    plain.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(plain.vertices), 2)), material=material)
    plain.export(folder / "plain.glb")
