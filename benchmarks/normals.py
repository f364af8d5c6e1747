"""Measures how far the direction of the transport's linear band is from the normal, on figures that no training saw.

    python benchmarks/normals.py results/held relight/weights/photo.onnx

The folder is that of benchmarks/photographs.py, whose pictures of figures these are. Angles in degrees, over all pixels
of the figures: of the direction of the true transport, of that of the inferred transport (what `relight photo --maps`
writes), of the latter corrected by the quadratic polynomial of the nine coefficients that fits best on the other half
of the figures, and of a plane that faces the camera.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from pathlib import Path

import numpy as np
import torch
from omegaconf import OmegaConf
from photographs import KINDS

from relight.config import composed
from relight.learning.augment import augment_batch
from relight.learning.checkpoint import load_network
from relight.learning.data import RelitSet
from relight.progress import progress
from relight.sh import UNOCCLUDED_T00, mean_direction

OPEN, HOLLOW = 0.9, 0.6  # ambient occlusion above which a pixel is hardly occluded, and below which it is much
PENALTY = 1e-5  # of the polynomial's coefficients, over their features' mean squares
Figures = list[tuple[np.ndarray, np.ndarray, np.ndarray]]


@torch.inference_mode()
def pixels(network: torch.nn.Module, data: RelitSet, kind: list[str]) -> Figures:
    """Infers each figure under one test light.

    Args:
        network: in evaluation mode.
        data: figures and lights.
        kind: overrides of the settings of the pictures, a value of KINDS.

    Returns:
        For each figure inferred transport (P,9), true transport (P,9) and true normals (P,3) at its P pixels.
    """
    settings, test = OmegaConf.to_object(composed(kind).augment), np.flatnonzero(data.light_split == "test")
    figures = data.figures(sorted(set(data.figure_of)))
    rows = []
    for i, figure in enumerate(progress(figures, "figures")):
        batch = data.batch(np.array([figure]), test[[i % len(test)]])
        batch = augment_batch(batch, settings, [np.random.default_rng(i)], network.size)
        inside = batch.inside[0, :, 0] > 0
        inferred = batch.gather(network(batch.image, batch.mask)["transport"])
        rows.append(tuple(values[0, inside].numpy() for values in (inferred, batch.transport, batch.normal)))
    return rows


def polynomial(transport: np.ndarray) -> np.ndarray:
    """Returns all products (P,55) of up to two of the nine coefficients."""
    padded = np.concatenate([np.ones((len(transport), 1)), transport], 1)
    first, second = np.triu_indices(padded.shape[1])
    return padded[:, first] * padded[:, second]


def corrected(rows: Figures) -> np.ndarray:
    """Returns the normals (P,3) of all figures, each half by the polynomial that fits the other half."""
    halves = [np.concatenate([polynomial(inferred) for inferred, _, _ in rows[i::2]]) for i in (0, 1)]
    normals = [np.concatenate([normal for _, _, normal in rows[i::2]]) for i in (0, 1)]
    moments = [half.T @ half + PENALTY * len(half) * np.eye(half.shape[1]) for half in halves]
    weights = [np.linalg.solve(moments[i], halves[i].T @ normals[i]) for i in (0, 1)]
    counts = [[len(normal) for _, _, normal in rows[i::2]] for i in (0, 1)]
    parts = [np.split(halves[i] @ weights[1 - i], np.cumsum(counts[i])[:-1]) for i in (0, 1)]
    return np.concatenate([parts[i % 2][i // 2] for i in range(len(rows))])


def angles(directions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Returns the angles (P,) between vectors (P,3), in degrees."""
    lengths = np.linalg.norm(directions, axis=1) * np.linalg.norm(normals, axis=1)
    cosine = np.einsum("pc,pc->p", directions, normals) / np.maximum(lengths, 1e-12)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def main() -> None:
    """Prints the angle in degrees between the normal and each estimate of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("weights", type=Path)
    args = parser.parse_args()
    torch.set_num_threads(1)
    network, _ = load_network(args.weights)
    data = RelitSet(args.results / "packed.safetensors", args.results / "lights" / "lights.npz", network.order, "photo")
    print("| pictures | direction | mean | median | 90 % below | mean where open | mean in hollows |\n|" + "---|" * 7)
    for title in ("as relit", "photographs"):
        rows = pixels(network, data, KINDS[title])
        inferred, true, normal = (np.concatenate(values) for values in zip(*rows))
        occlusion = true[:, 0] / UNOCCLUDED_T00
        candidates = {
            "of the true transport": mean_direction(true),
            "of the inferred transport": mean_direction(inferred),
            "the same, corrected": corrected(rows),
            "toward the camera": np.broadcast_to([0.0, 0.0, 1.0], normal.shape),
        }
        for name, directions in candidates.items():
            angle = angles(directions, normal)
            parts = angle.mean(), *np.percentile(angle, [50, 90])
            parts += angle[occlusion > OPEN].mean(), angle[occlusion < HOLLOW].mean()
            print(f"| {title} | {name} | " + " | ".join(f"{value:.1f}" for value in parts) + " |")


if __name__ == "__main__":
    main()
