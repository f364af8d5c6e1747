from pathlib import Path

from relight.lab.job import job

with job(snakemake):
    given, params, condition = snakemake.input, snakemake.params, snakemake.wildcards.on.strip("/") or "test"
    files = Path(given.packed), Path(given.lights), Path(given.split), condition, Path(snakemake.output[0])
    if given.network:
        from relight.evaluation.scoring.evaluate import evaluate
        from relight.lab.tracking.run import log_scores

        network = Path(str(given.network))
        evaluate(network, *files)
        log_scores(snakemake.config["job"]["tracking"], network, condition, files[-1])
    else:
        from relight.evaluation.scoring.baselines import evaluate_baselines

        evaluate_baselines(*files, params.color, params.order)
