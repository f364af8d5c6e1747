"""Makes the site's page of licences: that of each package that `make` installs, from its metadata (tools/hooks.py)."""

import re
import subprocess
import sys
from importlib import metadata

HEAD = """\
# Licences of what is installed

relight's own code is Apache-2.0. These are the packages that `make` installs (the extra `dev` of `uv.lock`, and torch),
with the licence that each states in its metadata, or else in its licence file. CUDA builds of torch bring NVIDIA's
libraries (`nvidia-*`, under NVIDIA's own terms) and triton (MIT). **pymeshlab is GPL-3**: see `NOTICE`.

| package | version | licence | home |
|---|---|---|---|
"""
TORCH = ("torch", "filelock", "fsspec")  # with what it alone needs; uv.lock is without
TEXTS = {  # words of a licence -> its name
    "Apache License": "Apache-2.0",
    "Permission is hereby granted, free of charge": "MIT",
    "Redistributions in binary form": "BSD",
    "Redistribution and use in source and binary forms": "BSD",
    "Mozilla Public License": "MPL-2.0",
}


def licence(package: metadata.Distribution) -> str:
    """Returns the licence of a package: from its metadata, its classifiers, or the text of its licence files."""
    stated = package.metadata.get("License-Expression") or package.metadata.get("License") or ""
    if stated and "\n" not in stated and stated.upper() != "UNKNOWN":
        return stated
    classifiers = package.metadata.get_all("Classifier", [])  # such as License :: OSI Approved :: MIT License
    classified = [line.rpartition(" :: ")[2] for line in classifiers if line.startswith("License ::")]
    if named := [line for line in classified if line != "OSI Approved"]:
        return "; ".join(named)
    files = [file for file in package.files or [] if re.match(r"(licen[sc]e|copying)", file.name, re.IGNORECASE)]
    texts = [stated, *(file.read_text() for file in files)]
    return next((name for words, name in TEXTS.items() if any(words in text for text in texts)), "not stated")


def home(package: metadata.Distribution) -> str:
    """Returns the address of a package's home page or repository; empty if it states none."""
    links = {}  # name in small letters -> address
    for line in package.metadata.get_all("Project-URL", []):
        name, _, address = line.partition(", ")
        links[name.lower()] = address
    preferred = ("homepage", "home", "source", "source code", "repository")
    named = next((links[name] for name in preferred if name in links), None)
    return named or package.metadata.get("Home-page") or next(iter(links.values()), "")


def locked() -> set[str]:
    """Returns the names of the packages that `make` installs, for all platforms."""
    command = [sys.executable, "-m", "uv", "export", "--frozen", "--no-emit-project", "--no-hashes", "--extra=dev"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return {*re.findall(r"^([\w.-]+)==", text, re.M), *TORCH}


def page() -> str:
    """Returns the text of the page."""
    rows, not_installed = [], []
    for name in sorted(locked(), key=str.lower):
        try:
            package = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            not_installed.append(name)
            continue
        version = package.version.partition("+")[0]  # without the part of local builds, such as +cpu
        rows.append(f"| {package.metadata['Name']} | {version} | {licence(package)} | {home(package)} |\n")
    footer = f"\nOn other platforms or versions of Python only: {', '.join(not_installed)}.\n" if not_installed else ""
    return HEAD + "".join(rows) + footer
