"""Records of how results were made: results/<name>/made/<output>.json, which is copied with the results.

A record has the `rule` and the `params` of its job, and `by` what it was run: machine and packages; the hashes of the
`code` that this ran, by module; the `inputs` by path, those that it `found` by itself, and the `files` of the output,
with bytes and hashes; `dates` of these files, and of those that it `read` of the user; and, while a job makes the
output, `unfinished`, true if it keeps some, with the `old` files that the new ones replace. Paths are relative to
results/<name>.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from relight.core.errors import UserError
from relight.core.files import file_hash, read_record, write_json
from relight.extensions import READ
from relight.lab.code import code_hash, code_of

CHANGED = "'changed: "  # begins a param in Snakemake's metadata, by which it runs a job again
Content = dict[str, list[Any]]  # name in a folder, or "" of a file -> bytes, hash
Record = dict[str, Any]


def read(output: str) -> Record:
    """Returns the record of a file or folder; {} if it has none that can be read."""
    record = read_record(record_file(output))
    return record if all(isinstance(record.get(part), dict) for part in ("params", "inputs", "files", "code")) else {}


def record_file(output: str) -> Path:
    """Returns the file of the record of an output, results/<name>/..."""
    folder = folder_of(output)
    return folder / "made" / f"{os.path.relpath(output, folder)}.json"


def folder_of(output: str) -> Path:
    """Returns the folder of the results that an output is in."""
    return Path(*Path(output).parts[:2])


def stats(path: str) -> dict[str, os.stat_result]:
    """Returns the status of each file in a folder by name, or of a file under ""; {} if there is none."""
    entries: dict[str, Any] = (
        {entry.name: entry for entry in os.scandir(path)} if os.path.isdir(path) else {"": Path(path)}
    )
    return {name: entry.stat() for name, entry in sorted(entries.items()) if name[:1] != "." and entry.is_file()}


def content(path: str, record: Record | None = None) -> Content:
    """Returns the content of a file or folder; {} if there is none. Files of recorded size and date are not read."""
    found, record = {}, read(path) if record is None else record
    for name, stat in stats(path).items():
        known = record.get("files", {}).get(name, [])
        same = stat.st_size in known and record.get("dates", {}).get(name) in (stat.st_mtime_ns, stat.st_ctime_ns)
        found[name] = known if same else [stat.st_size, file_hash(Path(path, name))[:16]]
    return found


def dated(output: str, record: Record) -> Record:
    """Returns a record with the dates, nanoseconds, of its files, and of the user's files among the inputs.

    Those of the user's are of the last change of any kind, which `touch -r`, `mv` and `unzip` do not set.
    """
    given = {name: found_at(output, name) for name in inputs_of(record)}
    sources = {name: stats(path) for name, path in given.items() if not path.startswith("results/")}
    read = {name: {file: stat.st_ctime_ns for file, stat in found.items()} for name, found in sources.items()}
    return {**record, "dates": {name: stat.st_mtime_ns for name, stat in stats(output).items()}, "read": read}


def inputs_of(record: Record) -> dict[str, Content]:
    """Returns the contents of what a job was given, and of what it found by itself, by their names in its record."""
    return {**record["inputs"], **record.get("found", {})}


def found_at(output: str, name: str) -> str:
    """Returns the path of an input by its name in the record of an output."""
    return os.path.normpath(folder_of(output) / name)


def named(paths: Iterable[str], output: str) -> dict[str, Content]:
    """Returns the contents of files and folders by their names in the record of an output."""
    folder = folder_of(output)
    return {path if path[0] == "/" else os.path.relpath(path, folder): content(path) for path in paths}


def describe(rule: str, params: Mapping[str, Any], inputs: Iterable[str], output: str) -> Record:
    """Returns what decides the outputs of a job, as in its record: `rule`, `params` and `inputs`."""
    return json.loads(json.dumps({"rule": rule, "params": dict(params), "inputs": named(inputs, output)}))


def begin(outputs: list[str], job: Record) -> set[str]:
    """Prepares outputs for a job, or ends this process where they are already what it would make.

    Outputs are files, or one folder. Of a folder, the figures stay that the job would make again: with the same files,
    inputs and params, apart from `names`, which say what other figures there are. This returns their names; `finish`
    removes all others.
    """
    before, files = {output: read(output) for output in outputs}, {output: content(output) for output in outputs}
    found = [found_at(outputs[0], name) for name in before[outputs[0]].get("found", {})]
    job = {**job, "found": named(found, outputs[0])}
    code_of(job["rule"])  # which keeps the hashes for `finish`, whoever edits a file meanwhile
    same_code = not any(map(changed_code, before.values()))
    if same_code and all({**record, **job, "files": files[output]} == record for output, record in before.items()):
        for output, record in before.items():
            record = {key: value for key, value in record.items() if key not in ("unfinished", "old")}
            write_json(record_file(output), dated(output, record))
        sys.exit(print("kept: it was made with these inputs, settings and code"))
    stay: set[str] = set()
    old: dict[str, list[int]] = {}
    if os.path.isdir(folder := outputs[0]):
        record = before[folder]
        if record and same_code and {**record["params"], "names": 0} == {**job["params"], "names": 0}:
            now, then = {**inputs_of(job), "": files[folder]}, {**inputs_of(record), "": record["files"]}
            names = {name.partition(".")[0] for name in record["files"]}
            stay = {name for name in names if _of(now, name) == _of(then, name)} & {*job["params"].get("names", names)}
        leaving = {name: stat for name, stat in stats(folder).items() if name.partition(".")[0] not in stay}
        old = {name: [stat.st_ino, stat.st_mtime_ns] for name, stat in leaving.items()}
    for output, record in before.items():
        kept = record or {**job, "code": {}, "files": {"": []}}  # of which there is none
        write_json(record_file(output), {**kept, "unfinished": bool(stay), "old": old})
    return stay


def finish(outputs: Iterable[str], job: Record) -> None:
    """Removes old files that a job has not made anew from its outputs, and writes their records."""
    for output in outputs:
        before = read(output)
        for name, stat in stats(output).items():
            if before.get("old", {}).get(name) == [stat.st_ino, stat.st_mtime_ns]:
                Path(output, name).unlink()
        stays = before if before.get("unfinished") else {}
        code = {**stays.get("code", {}), **code_of(job["rule"])}
        found = {**stays.get("found", {}), **named(READ, output)}
        made = {**job, "code": code, "found": found, "files": content(output)}
        write_json(record_file(output), dated(output, made))


def changed_code(record: Record) -> str | None:
    """Returns a module that has changed since a record was written, or None."""
    return next((module for module, made in record.get("code", {}).items() if code_hash(module) != made), None)


def outdated(output: str, record: Record, read: Callable[[str], Record | None] = read) -> str | None:
    """Returns what has changed since the record of an existing output was written, in a few words, or None."""
    found = content(output)
    for name, entry in record["files"].items():
        if found.get(name) != entry:
            return f"{Path(output, name)} {'is another one' if name in found else 'is missing'}"
    here = any(os.path.exists(found_at(output, name)) for name in record["inputs"])  # else a copy came without
    for name, files in inputs_of(record).items():
        path, known = found_at(output, name), {"files": files, "dates": record.get("read", {}).get(name, {})}
        now = ((path.startswith("results/") and read(path)) or {"files": content(path, known)})["files"]
        if now != files and (now or (now == {} and here and name in record.get("found", {}))):
            return f"{output} was made of another {name}"
    return None


def is_made(output: str) -> bool:
    """Returns whether an output exists that no failed job has left as it was before."""
    return os.path.exists(output) and "unfinished" not in read(output)


def records_of(outputs: Iterable[str]) -> Iterator[tuple[str, Record]]:
    """Yields outputs and all that they were made of, with their records, each once."""
    found, pending = set(), [*outputs]
    while pending:
        if (output := pending.pop(0)) not in found and (record := read(output)):
            found.add(output)
            pending += [found_at(output, name) for name in record["inputs"]]
            yield output, record


def restore(out: str, begin: Callable[[], object] = lambda: None) -> dict[str, str]:
    """Has Snakemake read the records of results as its metadata.

    Files that have lost their dates have one in its plan. Before it makes anything, `begin` is called, and they get it;
    else this writes nothing. Returns what has changed since outputs were made, settings aside, by output.
    """
    import snakemake.api  # which imports snakemake.workflow
    from snakemake.exceptions import WorkflowError
    from snakemake.persistence import RECORD_FORMAT_VERSION, MetadataRecord
    from snakemake.persistence.file import FilePersistence

    made, now, version = Path(out, "made"), time.time_ns(), {"record_format_version": RECORD_FORMAT_VERSION}
    outputs = [str(Path(out, file.relative_to(made).with_suffix(""))) for file in made.rglob("[!.]*.json")]
    records, reasons = {output: record for output in outputs if (record := read(output))}, dict[str, str]()
    known, undated = dict[str, dict[str, Any]](), list[str]()
    for output, record in records.items():
        exists = os.path.exists(output)  # or Snakemake looks for changes in what was made of it
        reason = outdated(output, record, records.get) if exists else None
        undated += [output] if exists and not reason and record != dated(output, record) else []
        if "unfinished" in record:
            reason = f"{output} is unfinished"
        elif module := changed_code(record):
            reason = f"{module} has changed"
        reasons |= {output: reason} if reason else {}
        params = sorted([*map(repr, record["params"].values()), *([f"{CHANGED}{reason}'"] if reason else [])])
        inputs = sorted(found_at(output, name) for name in record["inputs"])
        known[output] = {"rule": record["rule"], "params": params, "input": inputs, **version}

    class Records(FilePersistence):  # type: ignore[misc]  # Snakemake has no types
        def __init__(self, dag: Any, db_url: str = "", **options: Any):
            super().__init__(dag=dag, **options)
            dag.workflow.iocache.mtime.update(dict.fromkeys(undated, snakemake.io.Mtime(now / 1e9)))
            if not dag.workflow.executor_plugin or dag.workflow.dryrun:  # as for --summary
                return
            try:
                begin()
                for output in undated:
                    if (record := read(output)) == records[output]:  # nobody has made it meanwhile
                        for name in (*record["files"], ".snakemake_timestamp"):
                            with suppress(OSError):
                                os.utime(Path(output, name), ns=(now, now))
                        write_json(record_file(output), dated(output, record))
            except UserError as error:
                raise WorkflowError(str(error)) from None

        def _read_record(self, key: str) -> Any:
            found = super()._read_record(key)
            return (found or MetadataRecord()).model_copy(update=known[key]) if key in known else found

    snakemake.workflow.FilePersistence = snakemake.workflow.DbPersistence = Records
    return reasons


def _of(contents: Mapping[str, Content], figure: str) -> dict[str, Content]:
    """Returns the contents of single files, and those of a figure in folders."""
    return {
        path: {name: entry for name, entry in files.items() if name.partition(".")[0] in ("", figure)}
        for path, files in contents.items()
    }
