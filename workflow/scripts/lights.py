import json
from pathlib import Path

from relight.core.files import write_text
from relight.lab.job import job
from relight.lights import build_light_set, write_light_set
from relight.settings import Lights, Panoramas

with job(snakemake):
    given = snakemake.params
    light_set, dropped = build_light_set(Panoramas(**given.panoramas), Lights(**given.lights), given.bake["order"])
    write_text(snakemake.output.record, json.dumps(dropped, indent=1))
    write_light_set(light_set, Path(snakemake.output.lights))
