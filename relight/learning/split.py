"""Splits of the figures into training, validation and test, with seated figures as a part of their own."""

import json
from collections.abc import Mapping, Set
from pathlib import Path
from typing import Any

import numpy as np

from relight.core.errors import UserError
from relight.core.files import write_text
from relight.maps import PackedMaps
from relight.settings import Split

VALIDATION = 0.1  # share of the figures for training that are left out of it for the validation
MAX_VALIDATION = 8  # figures
VALIDATION_DRAWS = 1  # beside the seed: makes the draws of the validation independent of those of the test


def split_figures(
    names: list[str], subjects: list[str], split: Split, sitting: Set[str] = frozenset()
) -> dict[str, list[str]]:
    """Splits figures into parts: first the test, then the validation from what is left.

    Seated figures are a part of their own, as in the paper (section 6), unless `split.sitting=dealt`. The others are
    split by `split.kind`:

    - `subject` draws whole subjects until the test has the share `split.test`: no person is on both sides.
    - `paper` draws figures at random (section 5): figures of one person may be on both sides.

    The validation gets whole subjects with `subject`, unless each is far more than it should have, and single figures
    otherwise; none if only one is left.

    Args:
        names: names of all figures.
        subjects: the person of each.
        split: settings.
        sitting: names of the seated figures.

    Returns:
        Names by part, `train`, `validation`, `test` and `sitting`, each in the order of `names`; train and test are
        never empty.

    Raises:
        UserError: if there are too few figures or subjects.
    """
    if split.sitting == "dealt":
        sitting = set()
    seated = [name for name in names if name in sitting]
    subjects = [subject for name, subject in zip(names, subjects) if name not in sitting]
    names = [name for name in names if name not in sitting]
    unit_of = dict(zip(names, subjects if split.kind == "subject" else names))
    if (count := len(set(unit_of.values()))) < 2:
        what = "subjects" if split.kind == "subject" else "figures"
        raise UserError(f"split: at least two {what} are needed, one for training and one for the test, not {count}")
    test = draw(unit_of, split.test * len(unit_of), np.random.default_rng(split.seed))
    train = [name for name in unit_of if name not in test]
    wanted = min(MAX_VALIDATION, VALIDATION * len(train))
    units = [unit_of[name] for name in train]
    if all(is_too_large(unit, units, wanted) for unit in units):
        units = train
    held_out = draw(dict(zip(train, units)), wanted, np.random.default_rng([split.seed, VALIDATION_DRAWS]))
    train = [name for name in train if name not in held_out]
    return {"train": train, "validation": held_out, "test": test, "sitting": seated}


def write_split(settings: Split, packed: Path, record: Path, out: Path) -> None:
    """Writes the names of the figures by part of the split: train, validation, test and so on (.json).

    Args:
        settings: of the split.
        packed, record: as from `relight.maps.pack_figures`.
        out: the split (.json).
    """
    packed_maps = PackedMaps(packed)
    # Of frontal views in the first outfit, whose maps have the name of the figure.
    subjects = {
        name: subject
        for name, subject, figure in zip(packed_maps.names, packed_maps.subjects, packed_maps.figures)
        if name == figure
    }
    sitting = {name for name, info in json.loads(record.read_text())["figures"].items() if is_seated(info)}
    write_text(out, json.dumps(split_figures(list(subjects), list(subjects.values()), settings, sitting), indent=1))


def draw(unit_of: Mapping[str, str], wanted: float, rng: np.random.Generator) -> list[str]:
    """Draws whole units until about `wanted` figures are drawn: at least one unit, never all, too large ones last.

    Args:
        unit_of: the unit of each figure, such as its subject.
        wanted: number of figures.
        rng: draws the units.
    """
    units = list(unit_of.values())
    order = sorted(set(units))
    rng.shuffle(order)
    order.sort(key=lambda unit: is_too_large(unit, units, wanted))
    drawn: set[str] = set()
    count = 0
    for unit in order[:-1]:
        size = units.count(unit)
        if drawn and count + size / 2 > wanted:
            break
        drawn.add(unit)
        count += size
    return [name for name, unit in unit_of.items() if unit in drawn]


def is_too_large(unit: str, units: list[str], wanted: float) -> bool:
    """Returns whether a unit of several figures, whose `units` these are, is more than twice what is wanted."""
    return units.count(unit) > max(1, 2 * wanted)


def is_seated(info: Mapping[str, Any]) -> bool:
    """Returns whether the figure of a record (`Maps.info`) is seated, by its `sitting` or else the name of its pose."""
    return bool(info.get("sitting", str(info.get("pose", "")).startswith("sitting")))
