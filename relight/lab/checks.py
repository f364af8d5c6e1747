"""Checks a plan before anything runs, so that what would make the workflow fail later is said at once."""

import os
import re
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.core.text import read_table
from relight.figures.draw.constraints import Constraints
from relight.lab.made import outdated, read, record_file, records_of, restore
from relight.lab.plan import DATA, Plan
from relight.lab.record import read_record
from relight.meshes.alignment import read_align_table
from relight.meshes.scans import one_subject
from relight.settings import flat

MAX_CLOCK_SKEW = 60  # seconds by which the clock of a file server may be ahead


def check(plan: Plan) -> None:
    """Checks the settings of all rows, and the user's folders and files.

    Args:
        plan: of the run.

    Raises:
        UserError: if a row, a folder or a file would make the workflow fail later.
    """
    for sentence in (*_files(plan), *_data(plan), *_rows(plan)):
        raise UserError(sentence)


def check_figures(plan: Plan) -> None:
    """Raises UserError if no figure can be made, or there is one alone, or one person: some train, others test."""
    if len(plan.figures) < 2:
        raise UserError(
            f"a training and its test need at least two figures, and there is only {plan.figures[0]}: "
            "`relight bake MESH --out FILE.exr` bakes one mesh"
        )
    figures, split = plan.shared["figures"], plan.shared["split"]
    if split["kind"] == "subject" and (sentence := one_subject(plan.scans)):
        raise UserError(sentence)
    if figures["source"] != "generated":
        return
    Constraints(figures["sitting"], *(tuple(figures[key]) for key in ("poses", "garments", "hair")))
    first, count, share = (figures[key] for key in ("first", "count", "per_subject"))
    if split["kind"] == "subject" and first // share == (first + count - 1) // share:
        raise UserError(f"figures.per_subject={share} makes one person of all {count} figures: a split needs two")
    if split["sitting"] == "apart" and figures["sitting"] == 1:
        raise UserError("figures.sitting=1: all figures sit, and none is left to train on; give split.sitting=dealt")


def _files(plan: Plan) -> Iterator[str]:
    """Yields messages about the user's files, and about results that were made of others."""
    before = flat(read_record(Path(plan.out))["settings"])
    for key, value in flat({group: plan.shared[group] for group in ("figures", "panoramas")}).items():
        if key.endswith((".source", ".folder")) and before.get(key, value) != value:
            yield (
                f"{plan.out} was made with {key}={before[key]}: give this run a name of its own, name=NAME, or remove "
                f"the folder {plan.out}"
            )
    table = plan.shared["align"]["table"]
    files, named = ([Path(table)], read_align_table(table).keys()) if table else ([], set())
    for name in sorted(named - set(plan.figures)):
        yield f"align.table={table} names {name}, and no figure is called so: `relight scans list` lists their names"
    files += [*map(Path, plan.panoramas + plan.table), *(scan.path for scan in plan.scans.values())]
    for scans in [] if table else plan.table:
        for axis in {"up", "front", "turn"}.intersection(read_table(Path(scans))[0]):
            yield f"{scans} has a column `{axis}`, which is read from align.table: give align.table={scans}, too"
    limit = time.time() + MAX_CLOCK_SKEW
    for path in files:
        if path.exists() and path.stat().st_mtime > limit:  # Snakemake ends a job whose outputs are older
            yield f"{path} is dated in the future: correct this machine's clock, or `touch` the file"


def _data(plan: Plan) -> Iterator[str]:
    """Yields messages about the run whose data are taken."""
    if plan.data == plan.out:
        return
    name, taken = plan.shared["data"], [f"{plan.data}/{file}" for file in DATA]
    if not all(map(os.path.exists, taken)):
        yield f"data={name}: {plan.data} has no data set yet: relight run name={name} makes it"
    for output, record in records_of(taken):
        if os.path.exists(output) and (reason := outdated(output, record)):
            yield f"data={name}: {reason}; relight run name={name} makes it anew"
    for key, (made, value) in changed(plan, taken).items():
        yield f"data={name} has {key}={made}, and this run asks for {value}: leave out one of the two"
    if not (record := read(taken[0])):
        yield f"{taken[0]} has no record of how it was made: remove it, and relight run name={name} makes it anew"
    elif record["params"]["names"] != plan.map_names:
        yield f"{taken[0]} has other figures: leave out figures.count, or let relight run name={name} make them"


def changed(plan: Plan, outputs: Iterable[str]) -> dict[str, tuple[Any, Any]]:
    """Returns the settings of which outputs, or what they were made of, have other values: key -> theirs, planned."""
    found: dict[str, tuple[Any, Any]] = {}
    for output, record in records_of(outputs):
        training = Path(output).stem if record["rule"] == "train" else ""
        asked = plan.settings(training) if training in plan.trainings else {} if training else plan.shared
        made = record["params"].get("settings", record["params"])
        groups = made.keys() & asked.keys() - {"name", "experiments"}  # which a report shows
        then, now = flat({group: made[group] for group in groups}), flat(asked)
        found |= {key: (value, now[key]) for key, value in then.items() if now.get(key, value) != value}
    return found


def results_of(plan: Plan) -> list[str]:
    """Returns the outputs whose settings tell those of all: the data, the split and the networks."""
    return [*(f"{plan.data}/{name}" for name in DATA), f"{plan.out}/split.json", *map(plan.network, plan.trainings)]


def changes(plan: Plan, begin: Callable[[], object] = lambda: None) -> Iterator[str]:
    """Gives Snakemake the records of a run, by `restore`, and yields what to say before it begins."""
    made = results_of(plan)
    if settings := sorted(changed(plan, made)):
        more = f" and {len(settings) - 4} more" if len(settings) > 4 else ""
        yield (
            f"{plan.out} was made with other settings ({', '.join(settings[:4])}{more}): what depends on them is "
            "outdated; to keep both, give this run a name, name=NAME"
        )
    reasons = restore(plan.out, begin)
    tables = {file.stem: str(file) for file in sorted(Path(plan.out, "report").glob("*.md"))}
    earlier = ((name, file) for name, file in tables.items() if name not in plan.requested)
    if old := [name for name, file in earlier if changed(plan, [file]) or reasons.keys() & dict(records_of([file]))]:
        yield f"{plan.out}/report keeps tables of other settings, data or code, of experiment=[{','.join(old)}]"
    told = {
        reason
        for output, reason in reasons.items()
        if Path(output).stem in plan.trainings  # not of earlier experiments, which stay
        or not re.search("/(evaluate|report|train)/", output)
    }
    for reason in sorted(told)[:4]:
        yield f"since {plan.out} was made: {reason}"
    made += [f"{plan.data}/{kind}/{batch}" for kind in ("figures", "aligned", "maps") for batch in plan.batches]
    if unknown := [output for output in made if os.path.exists(output) and not record_file(output).exists()]:
        more = f", and {len(unknown) - 1} more like it" if len(unknown) > 1 else ""
        yield f"{unknown[0]} has no record of how it was made, and is kept{more}"


def _rows(plan: Plan) -> Iterator[str]:
    """Yields messages about rows that cannot be trained, or not be compared with the baselines of their table."""
    shared = plan.shared
    for row, settings in plan.record["rows"].items():
        if (start := settings["train"]["start"]) and start not in plan.rows:
            existing_file(start, f"row {row}: train.start")
            from relight.learning.checkpoint import read_config

            read_config(start)
        if settings["model"]["order"] > shared["bake"]["order"]:
            yield (
                f"row {row} has model.order={settings['model']['order']}, and the maps have bake.order="
                f"{shared['bake']['order']}: give a bake.order as high"
            )
    for row in dict.fromkeys(row for experiment in plan.experiments.values() for row in experiment.rows):
        train = plan.record["rows"][row]["train"]
        if train["color"] != shared["train"]["color"]:
            yield (
                f"row {row} has train.color={train['color']}, and the baselines {shared['train']['color']}: their "
                f"errors cannot be compared; give train.color={train['color']} to the run, under a new name"
            )
        if train["size"] not in (None, shared["bake"]["size"]):
            yield (
                f"row {row} has train.size={train['size']}, and is tested on maps of "
                f"bake.size={shared['bake']['size']}: give one size, or let another row start from it"
            )
