"""Records of how results were made: results/<name>/made/<output>.json, which is copied with the results.

A record has the `rule` and the `params` of its job; the hashes of the `code` that this ran, by module; the `inputs` by
path and the `files` of the output, with bytes and hashes; `dates` of these files, and of those that it `read` of the
user; and `unfinished` while a job makes the output, true if it keeps some, with the `old` files that the new ones
replace. Paths are relative to results/<name>.
"""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from relight.core.files import file_hash, write_json
from relight.lab.code import code_hash, code_of

CHANGED = "'changed: "  # begins a param in Snakemake's metadata, by which it runs a job again
Content = dict[str, list[Any]]  # name in a folder, or "" of a file -> bytes, hash
Record = dict[str, Any]


def read(output: str) -> Record:
    """Returns the record of a file or folder; {} if it has none that can be read."""
    try:
        record: Record = json.loads(record_file(output).read_bytes())
    except (OSError, ValueError):
        record = {}
    return record


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
        same = stat.st_size in known and stat.st_mtime_ns == record.get("dates", {}).get(name)
        found[name] = known if same else [stat.st_size, file_hash(Path(path, name))[:16]]
    return found


def dated(output: str, record: Record) -> Record:
    """Returns a record with the dates, nanoseconds, of its files, and of the user's files among the inputs."""

    def dates(path: str) -> dict[str, int]:
        return {name: stat.st_mtime_ns for name, stat in stats(path).items()}

    inputs = {name: found_at(output, name) for name in record["inputs"]}
    sources = {name: dates(path) for name, path in inputs.items() if not path.startswith("results/")}
    return {**record, "dates": dates(output), "read": sources}


def found_at(output: str, name: str) -> str:
    """Returns the path of an input by its name in the record of an output."""
    return os.path.normpath(folder_of(output) / name)


def describe(rule: str, params: Mapping[str, Any], inputs: Iterable[str], output: str) -> Record:
    """Returns what decides the outputs of a job, as in its record: `rule`, `params` and `inputs`."""
    folder = folder_of(output)
    contents = {path if path[0] == "/" else os.path.relpath(path, folder): content(path) for path in inputs}
    described: Record = json.loads(json.dumps({"rule": rule, "params": dict(params), "inputs": contents}))
    return described


def begin(outputs: list[str], job: Record) -> set[str]:
    """Prepares outputs for a job, or ends this process where they are already what it would make.

    Of a folder, the figures stay that it would make again: with the same files, inputs and params, apart from `names`,
    which say what other figures there are. All others are removed by `finish`.

    Args:
        outputs: files, or one folder.
        job: from `describe`.

    Returns:
        The names of the figures that stay.
    """
    before, files = {output: read(output) for output in outputs}, {output: content(output) for output in outputs}
    code_of(job["rule"])  # which keeps the hashes for `finish`, whoever edits a file meanwhile
    same_code = not any(map(changed_code, before.values()))
    if same_code and all({**before[output], **job, "files": files[output]} == before[output] for output in outputs):
        for output, record in before.items():
            record = {key: value for key, value in record.items() if key not in ("unfinished", "old")}
            write_json(record_file(output), dated(output, record))
        sys.exit(print("kept: it was made with these inputs, settings and code"))
    stay: set[str] = set()
    old: dict[str, list[int]] = {}
    if os.path.isdir(folder := outputs[0]):
        record = before[folder]
        if record and same_code and {**record["params"], "names": 0} == {**job["params"], "names": 0}:
            now, then = {**job["inputs"], "": files[folder]}, {**record["inputs"], "": record["files"]}
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
        before = read(output)  # whose code has made what stays
        for name, stat in stats(output).items():
            if before.get("old", {}).get(name) == [stat.st_ino, stat.st_mtime_ns]:
                Path(output, name).unlink()
        code = {**(before["code"] if before.get("unfinished") else {}), **code_of(job["rule"])}
        write_json(record_file(output), dated(output, {**job, "code": code, "files": content(output)}))


def changed_code(record: Record) -> str | None:
    """Returns a module, or a file that one has named, which has changed since a record was written, or None."""
    return next((module for module, made in record.get("code", {}).items() if code_hash(module) != made), None)


def outdated(output: str, record: Record, read: Callable[[str], Record | None] = read) -> str | None:
    """Returns what has changed since the record of an existing output was written, in a few words, or None."""
    found = content(output)
    for name, entry in record["files"].items():
        if found.get(name) != entry:
            return f"{Path(output, name)} {'is another one' if name in found else 'is missing'}"
    for name, files in record["inputs"].items():
        if (path := found_at(output, name)).startswith("results/"):
            now = (read(path) or {}).get("files")
        else:
            now = content(path, {"files": files, "dates": record.get("read", {}).get(name, {})})
        if now and now != files:
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


def restore(out: str) -> dict[str, str]:
    """Gives Snakemake the records of results as its metadata, where it has others or none.

    Args:
        out: the folder of the results, relative to the working directory.

    Returns:
        output -> what has changed since it was made, settings aside.
    """
    from snakemake.persistence import RECORD_FORMAT_VERSION, MetadataRecord
    from snakemake.persistence.file import FilePersistence

    store, made = FilePersistence(nolock=True), Path(out, "made")
    outputs = [str(Path(out, file.relative_to(made).with_suffix(""))) for file in made.rglob("[!.]*.json")]
    records, reasons = {output: read(output) for output in outputs}, dict[str, str]()
    for output, record in records.items():
        if not record or not os.path.exists(output):
            continue
        stamp = Path(output, ".snakemake_timestamp") if os.path.isdir(output) else Path(output)
        date = stamp.stat().st_mtime if stamp.exists() else 0.0
        if not (reason := outdated(output, record, records.get)) and record != (now := dated(output, record)):
            write_json(record_file(output), now)
        if "unfinished" in record:
            reason = f"{output} is unfinished"
        elif module := changed_code(record):
            reason = f"{module} has changed"
        reasons |= {output: reason} if reason else {}
        known = store._read_record(output) or MetadataRecord()
        params = sorted([*map(repr, record["params"].values()), *([f"{CHANGED}{reason}'"] if reason else [])])
        if (known.endtime, known.params) != (date, params):
            inputs = sorted(found_at(output, name) for name in record["inputs"])
            restored = MetadataRecord(rule=record["rule"], params=params, input=inputs, endtime=date)
            restored.record_format_version = RECORD_FORMAT_VERSION
            store._write_record(output, restored)
    return reasons


def _of(contents: Mapping[str, Content], figure: str) -> dict[str, Content]:
    """Returns the contents of single files, and those of a figure in folders."""
    return {
        path: {name: entry for name, entry in files.items() if name.partition(".")[0] in ("", figure)}
        for path, files in contents.items()
    }
