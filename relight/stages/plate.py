"""Draws the picture of an experiment with stages of its own: light_transfer or path_traced."""

from pathlib import Path

from relight.stages.networks import networks_of
from relight.stages.stage import stage


@stage(
    "plate",
    experiments="experiments (.json)",
    experiment="name of one of them",
    networks="folder of networks",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    reference="split (.json), or for path_traced the traced irradiance (.npz)",
    out="picture (.png)",
)
def main(
    experiments: Path,
    experiment: str,
    networks: Path,
    packed: Path,
    lights: Path,
    reference: Path,
    out: Path,
) -> None:
    """Draws some figures by the first network of each row of the experiment."""
    from relight.evaluation.experiments.path_traced import traced_plate
    from relight.evaluation.experiments.transfer import transfer_plate

    draw = {"light_transfer": transfer_plate, "path_traced": traced_plate}[experiment]
    _, by_row = networks_of(experiments, experiment, networks)
    draw(by_row, packed, lights, reference, out)


if __name__ == "__main__":
    main.cli()
