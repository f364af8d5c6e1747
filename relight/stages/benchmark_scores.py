"""Answers the benchmark by one method, and scores the answers."""

from pathlib import Path

from relight.config import Benchmark
from relight.files import atomic_write, temporary_folder
from relight.stages.stage import stage


@stage(
    "benchmark_scores",
    method="name of a training, shipped (the weights that come with relight), or name of a baseline",
    weights="network (.safetensors)",
    out="scores (.csv)",
)
def main(benchmark: Benchmark, method: str, weights: Path, out: Path) -> None:
    """Writes the scores of a method. The answers, which are large, are not kept."""
    from relight.benchmark.methods import BASELINES, answer
    from relight.benchmark.score import score

    with temporary_folder(out) as folder:
        answers = folder / method
        answer(benchmark.folder, answers, method if method in BASELINES else "network", weights)
        with atomic_write(out) as tmp:
            score(benchmark.folder, answers).replace(tmp)


if __name__ == "__main__":
    main.cli()
