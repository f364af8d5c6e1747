"""Runs the commands behind the numbers of the pages, and compares what they print with what the pages say.

python tools/claims.py            # the claims of docs/claims.yaml that take less than ten minutes (`make claims`)
python tools/claims.py all        # all of them
python tools/claims.py photo      # those with this word in their page, sentence or commands
"""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

ROOT = Path(__file__).parents[1]
CLAIMS = ROOT / "docs" / "claims.yaml"
QUICK = 10  # minutes
NUMBER = re.compile(r"(?<![\w.])[-−]?\d[\d,]*(?:\.\d+)?|(?<![\w.])[-−]?\.\d+")


def main(words: list[str]) -> int:
    """Checks claims, prints a line for each, and returns 1 if a number is not within its tolerance."""
    (ROOT / "build").mkdir(exist_ok=True)  # where commands put what they print
    failed = 0
    made: set[str] = set()
    for claim in yaml.safe_load(CLAIMS.read_text()):
        if "why" in claim or not wanted(claim, words):
            continue
        run = claim.get("run")
        if run and run not in made:
            print(f"$ {run}", flush=True)
            subprocess.run(run, shell=True, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
            made.add(run)
        if "cells" in claim:
            printed = cells(*claim["cells"].split())
        else:
            printed = subprocess.run(claim["show"], shell=True, cwd=ROOT, capture_output=True, text=True).stdout
        expected, found = numbers(claim["says"]), numbers(printed)
        good = agree(claim["says"], found, claim.get("within", 0))
        failed += not good
        print(
            f"{'within' if good else 'NOT   '}  {claim['page']}: {claim['says']!r}  expected {expected}, found {found}"
        )
    return int(failed > 0)


def wanted(claim: dict[str, Any], words: list[str]) -> bool:
    """Returns whether a claim is asked for: by `all`, by one of the words, or without words if it is quick."""
    if not words:
        return claim.get("minutes", 0) < QUICK
    told = " ".join(str(value) for value in claim.values())
    return words == ["all"] or any(word in told for word in words)


def cells(path: str, columns: str, rows: str) -> str:
    """Returns cells of a table of a report, row by row: each value, and half of its 95 % interval."""
    table = pd.read_csv(ROOT / path, index_col="row")
    found = [
        (table.at[row, name], (table.at[row, f"{name}_high"] - table.at[row, f"{name}_low"]) / 2)
        for row in rows.split(",")
        for name in columns.split(",")
    ]
    return "  ".join(f"{value} ± {half}" for value, half in found if not np.isnan(value))


def numbers(text: str) -> list[float]:
    """Returns the numbers in a text, without those that are parts of names such as g0012 or AVX2.

    >>> numbers("had 29 % (19 to 39 %) less, .173 of 4,000; AVX2")
    [29.0, 19.0, 39.0, 0.173, 4000.0]
    """
    return [float(word.replace(",", "").replace("−", "-")) for word in NUMBER.findall(text)]


def agree(says: str, found: list[float], within: float) -> bool:
    """Returns whether numbers are those of a sentence, up to its last printed digit or a relative tolerance."""
    words = NUMBER.findall(says)
    if len(words) != len(found):
        return False
    places = [len(word.partition(".")[2]) for word in words]
    return all(
        abs(told - value) <= max(0.5 * 10.0**-decimals, within * abs(told)) * 1.0001
        for told, value, decimals in zip(numbers(says), found, places, strict=True)
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
