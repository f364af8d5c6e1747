"""Path traces test figures in the panoramas of test lights."""

from pathlib import Path

from relight.config import Panoramas, Trace
from relight.stages.stage import stage


@stage(
    "trace",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    meshes="folder of aligned meshes",
    out="traced irradiance (.npz)",
)
def main(
    trace: Trace,
    panoramas: Panoramas,
    order: int,
    rays: int,
    packed: Path,
    lights: Path,
    split: Path,
    meshes: Path,
    out: Path,
) -> None:
    """Writes the irradiance of test figures by path tracing (`relight.evaluation.experiments.tracing.trace`).

    Args:
        trace: number of figures, paths per pixel, bounces.
        panoramas: source of the lights.
        order, rays: order of the transport, and rays per pixel by which it is baked.
        packed, lights, split, meshes, out: files.
    """
    from relight.evaluation.experiments import tracing

    tracing.trace(packed, lights, split, meshes, panoramas, trace, order, rays, out)


if __name__ == "__main__":
    main.cli()
