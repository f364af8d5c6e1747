"""Answers the benchmark by one method, and scores the answers."""

import shutil
from pathlib import Path

from relight.config import Benchmark
from relight.files import atomic_folder
from relight.stages.stage import stage


@stage(
    "benchmark_scores",
    method="a training or shipped, for a network; or a baseline",
    weights="network (.safetensors)",
    out="scores (.csv), in a folder that has nothing else",
)
def main(benchmark: Benchmark, method: Path, weights: Path, out: Path) -> None:
    """Writes the scores of a method; `method` is its name, not a file. The answers, which are large, are not kept."""
    from relight.benchmark.methods import BASELINES, answer
    from relight.benchmark.score import score

    with atomic_folder(out.parent) as folder:
        answers = folder / method.name
        answer(benchmark.folder, answers, method.name if method.name in BASELINES else "network", weights)
        score(benchmark.folder, answers).rename(folder / out.name)
        shutil.rmtree(answers)


if __name__ == "__main__":
    main.cli()
