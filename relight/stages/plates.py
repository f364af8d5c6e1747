"""The qualitative figure: some test figures as each network sees them."""

from pathlib import Path

from relight.config import Evaluate
from relight.stages.stage import stage


@stage(
    "plates",
    runs="runs, one per line (.txt)",
    networks="folder of networks",
    packed="packed set (.safetensors)",
    lights="lights (.npz)",
    split="split (.json)",
    out="picture (.png)",
)
def main(evaluate: Evaluate, runs: Path, networks: Path, packed: Path, lights: Path, split: Path, out: Path) -> None:
    from relight.evaluation.plates import plates

    first: dict[str, Path] = {}  # one training of each row stands for it
    for run in runs.read_text().split():
        first.setdefault(run.rpartition(".s")[0], networks / f"{run}.safetensors")
    plates(first, packed, lights, split, evaluate, out)


if __name__ == "__main__":
    main.cli()
