from functools import partial
from pathlib import Path

from relight.evaluation.pictures.panels import PLATE_FIGURES, evenly_spaced, extreme_places, plates, relit, shadings
from relight.evaluation.scoring.evaluate import Condition
from relight.lab.job import job

with job(snakemake):
    given, out, rows = snakemake.input, snakemake.output, snakemake.params.rows
    data = Path(given.packed), Path(given.lights), Path(given.split), Condition.parse(snakemake.params.condition)
    shown = dict(zip(rows, map(Path, given.networks))), *data
    plates(*shown, lambda names: evenly_spaced(len(names), PLATE_FIGURES), Path(out.plates))
    plates(*shown, partial(extreme_places, [Path(path) for path in given.scores]), Path(out.extremes))
    shadings(*shown, Path(out.overview))
    relit(*shown, Path(out.relit))
