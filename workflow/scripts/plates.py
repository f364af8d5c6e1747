from pathlib import Path

from relight.evaluation.pictures.panels import Shown, plates, relit, shadings, swapped
from relight.lab.job import job

with job(snakemake):
    given, out = snakemake.input, snakemake.output
    networks = dict(zip(snakemake.params.labels, map(Path, given.networks)))
    data = Path(given.packed), Path(given.lights), Path(given.split), snakemake.params.condition
    shown = Shown(networks, *data)
    plates(shown, Path(out.plates))
    shadings(shown, Path(out.overview))
    relit(shown, Path(out.relit))
    swapped(shown, Path(out.swapped))
