"""Packs a finished run: report, networks, scores, source, and how each job made what, as a Provenance Run Crate.

python tools/packet.py demo            # build/demo.crate.zip (`make packet ARGS=demo`)

Reference: https://www.researchobject.org/workflow-run-crate/profiles/provenance_run_crate
"""

import json
import mimetypes
import re
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rocrate.model import ContextEntity, Entity
from rocrate.rocrate import ROCrate

from relight.core.errors import UserError
from relight.lab.checks import changed, results_of
from relight.lab.made import Record, changed_code, outdated, read
from relight.lab.plan import Plan
from relight.lab.record import read_record

ROOT = Path(__file__).parents[1]
PROFILES = {f"https://w3id.org/ro/wfrun/{profile}/0.5": profile for profile in ("process", "workflow", "provenance")}
# What logs say after a job, and the unit by the codes of UN/CEFACT.
USED = {"cpuTime": (r"([\d.]+) s of CPU", "SEC"), "maxMemory": (r"([\d.]+) GB at most", "E34")}
# What is large, or a state of this machine, stays out; the records have the hashes.
CONTENT = ("run.yaml", "*.json", "lights/*", "made/**/*.json", "log/**/*", "train/*.*", "evaluate/**/*.csv", "report/*")
TEXT = dict.fromkeys((".log", ".smk", ".diff", ".rst", ".lock", ".yaml"), "text/plain") | {".md": "text/markdown"}
BIOSCHEMAS = "https://bioschemas.org/profiles/ComputationalWorkflow/1.0-RELEASE"
LICENSE = "https://spdx.org/licenses/Apache-2.0"
README = """# The run {name} of relight

Its report is `report/report.html`. To repeat it:

    mkdir source && tar -xzf source.tar.gz -C source
    make -C source run ARGS={words}

`made/` has a record of each output: rule and params of its job, versions of packages, hashes of code, inputs and files.
`ro-crate-metadata.json` lists the jobs with their times.
"""


def pack(name: str) -> Path:
    """Packs the run in results/<name>, and returns the file of the crate.

    Raises:
        UserError: if the run is not finished, is of other code, or has the data of another run.
    """
    out, build = Path("results", name), ROOT / "build"
    jobs, overrides = jobs_of(out), [word for word in read_record(out)["overrides"] if not word.startswith("name=")]
    plan = Plan(read_record(out))
    if other := sorted(changed(plan, results_of(plan))):
        raise UserError(
            f"{out} was made with other settings than its last command's ({', '.join(other)}): run it again"
        )
    crate = ROCrate(version="1.1")  # of which the profile is
    crate.name = f"The run {name} of relight"
    crate.description = "Settings, records of jobs, networks, scores and report of a run, and the source to repeat it"
    crate.license = crate.add(ContextEntity(crate, LICENSE, {"@type": "CreativeWork", "name": "Apache License 2.0"}))
    for path in sorted({path for pattern in CONTENT for path in out.glob(pattern) if path.is_file()}):
        add_file(crate, path, path.relative_to(out))
    commit, changes = git("rev-parse", "HEAD").strip(), git("diff", "HEAD")
    for path in [*ROOT.glob("workflow/[r-s]*/*.*"), ROOT / "uv.lock"]:
        code = {"@type": ["File", "SoftwareSourceCode", "SoftwareApplication"], "version": commit}
        add_file(crate, path, path.relative_to(ROOT), **(code if path.suffix == ".py" else {}))
    build.mkdir(exist_ok=True)
    archive = "git ls-files -z ':!benchmarks/*.onnx' | tar --null --files-from=- -czf build/source.tar.gz"
    subprocess.run(archive, shell=True, cwd=ROOT, check=True)
    add_file(crate, build / "source.tar.gz", version=commit + (" and source.diff" if changes else ""))
    words = shlex.join([f"name={name}", *overrides])
    readme = README.format(name=name, words=shlex.quote(words))
    for file, text in {"README.md": readme, "source.diff": changes}.items():
        if text:
            (build / file).write_text(text)
            add_file(crate, build / file, about=crate.root_dataset)
    describe(crate, jobs, out, f"relight run {words}")
    crate.write_zip(build / f"{name}.crate.zip")
    return build / f"{name}.crate.zip"


def add_file(crate: ROCrate, path: Path, place: Path | None = None, **properties: Any) -> None:
    """Adds a file with its format to a crate, by default at its top."""
    kind = TEXT.get(path.suffix) or mimetypes.guess_type(path)[0] or "application/octet-stream"
    crate.add_file(path, place or path.name, properties={"encodingFormat": kind, "name": path.name, **properties})


def git(*words: str) -> str:
    """Returns what git prints."""
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout


def jobs_of(out: Path) -> list[tuple[Record, list[str]]]:
    """Returns the record of each job of a finished run with its outputs, relative to the run, in order of their making.

    Raises:
        UserError: as `pack`.
    """
    found: dict[str, tuple[Record, list[str]]] = {}
    for file in (out / "made").rglob("[!.]*.json"):
        output = str(file.relative_to(out / "made").with_suffix(""))
        record = read(str(out / output))
        exists = (out / output).exists()  # what only other jobs need is deleted after them
        changed = (outdated(str(out / output), record) if exists else None) or changed_code(record)
        if changed or "unfinished" in record:
            raise UserError(
                f"{out / output} is not what this clone makes ({changed or 'unfinished'}): run it again first"
            )
        if other := next((path for path in record["inputs"] if path.startswith("..")), None):
            raise UserError(f"{out} has the data of another run ({other}): a packet needs data of its own")
        found.setdefault(json.dumps([record["rule"], record["inputs"], record["params"]]), (record, []))[1].append(
            output
        )
    if not any("report/report.html" in outputs for _, outputs in found.values()):
        raise UserError(f"{out} has no report: finish the run first")
    return sorted(found.values(), key=lambda job: max(job[0]["dates"].values()))


def describe(crate: ROCrate, jobs: list[tuple[Record, list[str]]], out: Path, command: str) -> None:
    """Adds the workflow, its steps, and an action for each job to a crate."""

    def add(identifier: str, kind: str, **properties: Any) -> Entity:
        """Adds an entity that is no file of the crate, once."""
        return crate.get(identifier) or crate.add(ContextEntity(crate, identifier, {"@type": kind, **properties}))

    def data(path: str) -> Entity:
        """Returns an input or output: a file of the crate, or what its record alone describes."""
        return crate.get(path) or add(
            f"#{path}", "CreativeWork", name=path, description="not here; its hashes are in made/"
        )

    crate.metadata.extra_terms["resourceUsage"] = "https://w3id.org/ro/terms/workflow-run#resourceUsage"
    crate.root_dataset["conformsTo"] = [add(url, "CreativeWork", name=name) for url, name in PROFILES.items()]
    kinds = {"@type": ["File", "SoftwareSourceCode", "ComputationalWorkflow", "HowTo"], "name": "relight"}
    place = "workflow/Snakefile"
    workflow = crate.add_workflow(ROOT / place, place, properties=kinds, main=True, lang="snakemake")
    workflow["conformsTo"], workflow["encodingFormat"] = (
        add(BIOSCHEMAS, "CreativeWork", name="Bioschemas"),
        "text/plain",
    )
    workflow["input"] = settings = crate.add_formal_parameter("settings", "File", "#settings", valueRequired=True)
    crate.get("run.yaml")["exampleOfWork"] = settings
    steps, actions, controls = [], [], []
    for record, outputs in jobs:
        rule, first = record["rule"], outputs[0]
        tool = crate.get(f"workflow/scripts/{rule}.py")
        step = add(f"#{rule}", "HowToStep", name=rule, position=str(len(steps)))
        step["workExample"] = tool
        steps += [] if step in steps else [step]
        text = log_of(out, rule, first)
        action = add(f"#{rule}-{first}", "CreateAction", name=f"{rule} {first}", endTime=moment(record))
        action["startTime"] = text[2:27] if text[:2] == "# " else None
        action["instrument"], action["result"] = tool, single([*map(data, outputs)])
        action["object"] = single([*map(data, record["inputs"])] or [crate.get("run.yaml")])
        action["resourceUsage"] = [
            add(f"{action.id}-{name}", "PropertyValue", name=name, propertyID=name, value=match[1], unitCode=unit)
            for name, (pattern, unit) in USED.items()
            if (match := re.search(pattern, text))
        ]
        actions.append(action)
        controls.append(add(f"#control-{rule}-{first}", "ControlAction", name=f"{rule} {first}"))
        controls[-1]["instrument"], controls[-1]["object"] = step, action
    workflow["step"], workflow["hasPart"] = steps, [step["workExample"] for step in steps]
    run = add("#run", "CreateAction", name=command, endTime=moment(jobs[-1][0]))
    run["instrument"], run["object"] = workflow, crate.get("run.yaml")
    run["result"] = [data(output) for _, outputs in jobs for output in outputs]
    whole = add("#snakemake-run", "OrganizeAction", name="Snakemake runs the jobs")
    whole["instrument"] = add(
        "https://snakemake.github.io", "SoftwareApplication", name="Snakemake", version=version("snakemake")
    )
    whole["object"], whole["result"] = controls, run
    crate.root_dataset["mentions"] = [run, whole, *actions]


def log_of(out: Path, rule: str, output: str) -> str:
    """Returns the last log of a job, log/<rule>/<...>.log: the longest of those that its output's name begins with."""
    folder, _, name = output.partition("/")
    found = {
        log.relative_to(top).as_posix()[:-4]: log
        for top in (out / "log" / folder, out / "log" / rule)
        for log in top.rglob("*.log")
    }
    best = max(filter(name.startswith, found), key=len, default="")
    logs = re.split(r"(?m)^(?=# \d{4}-)", found.get(best, out / "log" / f"{rule}.log").read_text())
    return next((log for log in reversed(logs) if "s of CPU" in log), "")


def single(values: list[Any]) -> Any:
    """Returns the only value of a list, or the list."""
    return values[0] if len(values) == 1 else values


def moment(record: Record) -> str:
    """Returns when the last file of an output was written."""
    return datetime.fromtimestamp(max(record["dates"].values()) / 1e9, UTC).isoformat(timespec="seconds")


if __name__ == "__main__":
    try:
        print(pack(*sys.argv[1:]).relative_to(ROOT))
    except UserError as error:
        sys.exit(str(error))
