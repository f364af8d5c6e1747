"""Times the untrained network of one row."""

from pathlib import Path

from relight.config import Model, Timing
from relight.stages.stage import stage


@stage("inference_time", row="its name in the table", out="times (.csv)")
def main(model: Model, timing: Timing, row: str, out: Path) -> None:
    """Writes the inference times of a network by size and device."""
    from relight.evaluation.experiments.timing import time_networks

    time_networks({row: model}, timing, out)


if __name__ == "__main__":
    main.cli()
