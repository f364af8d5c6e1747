"""Training and test figures, and those that sit."""

import numpy as np

from relight.config import Split
from relight.files import UserError


def deal(names: list[str], subjects: list[str], split: Split, sitting: set[str] = frozenset()) -> dict[str, list[str]]:
    """{"train": names, "test": names, "sitting": names}, each in the order of `names`; train and test are never empty.

    Figures in `sitting` are set apart, as in the paper (section 5.1): neither trained on nor in the test; with
    `split.sitting=dealt` there are none of these. Of the others

    - `subject` draws whole subjects for the test side until it holds the asked share, so no person is on both sides;
    - `paper` draws figures at random (section 5 of the paper), so frames of one person may fall on both sides;
    - `disjoint` and `siblings` are a pair of splits with one test set and as many training figures each: figures of the
      test subjects are dealt in turn to the test and to their siblings, which `siblings` trains on in the place of as
      many figures of other people. What differs is whether a network has seen the person that it is tested on.

    Raises UserError when there are too few figures or subjects for that.
    """
    if split.sitting == "dealt":
        sitting = set()
    apart = [name for name in names if name in sitting]
    subjects = [subject for name, subject in zip(names, subjects) if name not in sitting]
    names = [name for name in names if name not in sitting]
    if split.kind in ("disjoint", "siblings"):
        return {**paired(names, subjects, split), "sitting": apart}
    units = subjects if split.kind == "subject" else names
    order = sorted(set(units))
    if len(order) < 2:
        what = "subjects" if split.kind == "subject" else "figures"
        raise UserError(f"split: at least two {what} are needed, one to train on and one to test on, not {len(order)}")
    np.random.default_rng(split.seed).shuffle(order)
    wanted = split.test * len(names)
    test, count = set(), 0
    for unit in order[:-1]:
        size = units.count(unit)
        if test and count + size / 2 > wanted:
            break
        test.add(unit)
        count += size
    return {
        "train": [name for name, unit in zip(names, units) if unit not in test],
        "test": [name for name, unit in zip(names, units) if unit in test],
        "sitting": apart,
    }


def paired(names: list[str], subjects: list[str], split: Split) -> dict[str, list[str]]:
    """One of the two splits that differ only in whether the test subjects' other figures are trained on."""
    own: dict[str, list[str]] = {}
    for name, subject in zip(names, subjects):
        own.setdefault(subject, []).append(name)
    several = sorted(subject for subject, figures in own.items() if len(figures) > 1)
    rng = np.random.default_rng(split.seed)
    rng.shuffle(several)
    test, siblings, used = set(), set(), set()
    for subject in several:
        if len(test) >= split.test * len(names):
            break
        test |= set(own[subject][::2])
        siblings |= set(own[subject][1::2])
        used.add(subject)
    others = [name for name, subject in zip(names, subjects) if subject not in used]
    if not test or len(others) <= len(siblings):
        raise UserError(
            f"split.kind={split.kind} needs several figures of one person and more of other people: {len(several)} of "
            f"{len(own)} subjects have several; give figures.per_subject=4 and a larger figures.count"
        )
    dropped = set(rng.permutation(others)[: len(siblings)].tolist())
    trained = set(others) if split.kind == "disjoint" else (set(others) - dropped) | siblings
    return {"train": [n for n in names if n in trained], "test": [n for n in names if n in test]}


def sits(info: dict) -> bool:
    """Whether the figure of a record (`Maps.info`) sits, by its `sitting`, or else by the name of its pose."""
    return bool(info.get("sitting", str(info.get("pose", "")).startswith("sitting")))
