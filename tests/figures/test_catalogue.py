"""Catalogues: each entry is used, and an entry that does not fit its schema is refused in one sentence."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest

from relight.core.errors import UserError
from relight.figures.body import makehuman
from relight.figures.catalogue.schema import FOLDER, contents, entries
from relight.figures.drape.scarves import Wrap
from relight.figures.draw import garments
from relight.figures.draw.constraints import names
from relight.figures.draw.garments import GROUPS, Garment, group, wardrobe
from relight.figures.draw.hairstyles import style_odds, styles
from relight.figures.draw.outfits import shoe_odds
from relight.figures.draw.person import Iris, Shape, expressions, sample_person, units


@dataclass(frozen=True)
class Button:
    size: float
    kind: Literal["round", "square"] = "round"
    name: str = ""
    holes: int | None = None
    color: tuple[float, float, float] = (0.1, 0.1, 0.1)
    sewn: bool = False
    at: tuple[float, ...] = ()

    def __post_init__(self):
        if self.size > 1:
            raise ValueError("no button is so large")


def buttons(folder, text: str) -> dict[str, Button]:
    (folder / "buttons.yaml").write_text(text)
    contents.cache_clear()
    entries.cache_clear()
    return entries("buttons", "all", Button, folder)


def test_entries_are_converted_to_their_types(tmp_path):
    big = "big: &big {size: 1, holes: 4, color: [1, 0, 0.5], at: [1]}"
    flat = "flat: {<<: *big, size: 0.5, kind: square}"
    big, flat = buttons(tmp_path, f"all:\n  {big}\n  {flat}\n").values()
    assert big == Button(1.0, "round", "big", 4, (1.0, 0.0, 0.5), False, (1.0,)) and type(big.size) is float
    assert flat == Button(0.5, "square", "flat", 4, (1.0, 0.0, 0.5), False, (1.0,))


# what a catalogue says of all buttons, and what a sentence says of that
REFUSED = {
    "all:\n  b: {size: large}": "all: b: size: .*valid number",
    "all:\n  b: {size: 1, sewn: 1}": "sewn: .*valid boolean",
    "all:\n  b: {size: 1, hole: 3}": "hole: Unexpected keyword",
    "all:\n  b: {holes: 3}": "b: size: Field required",
    "all:\n  b: {size: 2}": "all: b: .*no button is so large",
    "all:\n  b: {size: 1}\n  b: {size: 2}": "b is given twice",
    "all:\n  b: {size: 1": "buttons.yaml: while parsing",
    "all:\n  b: {size: 1}\nall: {}": "all is given twice",
    **dict.fromkeys(["", "some:\n  b: {size: 1}", "all: 3"], r"buttons\.yaml needs a section all"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_entries_refuses_what_does_not_fit_in_one_sentence(tmp_path, text):
    with pytest.raises(UserError, match=REFUSED[text]) as error:
        buttons(tmp_path, f"{text}\n")
    assert "\n" not in str(error.value) and "buttons.yaml" in str(error.value)


def test_garment_refuses_what_cannot_be_cut(tmp_path, monkeypatch):
    (tmp_path / "garments.yaml").write_text("tops:\n  ruff:\n    kind: top\n    torso_ease: [0.1]\n")
    with pytest.raises(UserError, match=r"tops: ruff: .*torso_ease must have 6 numbers, not 1"):
        entries("garments", "tops", Garment, tmp_path)
    draws = {"trousers": ("jeans", "toga")}
    monkeypatch.setattr(garments, "entries", lambda *args: draws if args[1] == "draws" else entries(*args))
    with pytest.raises(UserError, match=r"draws: trousers: .*there is no garment toga"):
        garments.drawn_from("trousers")


def test_catalogue_sections_are_all_read():
    """A misspelled section would be silently without effect."""
    read = {
        "colors": {"neutrals", "colors", "denims", "leathers", "skin", "hair", "irises", "gloss"},
        "details": {"details"},
        "faces": {"shapes", "expressions", "lashes"},
        "garments": {"shared", "necks", "collars", "cloths", "draws", *GROUPS, "scarves", "wraps"},
        "hair": {"colors", "hairline", "combs", "styles"},
        "poses": {"hands", "feet", "trunks", "standing", "sitting"},
        "shoes": {"shoes"},
    }
    assert read == {path.stem: set(contents(path)) for path in FOLDER.glob("*.yaml")}


def test_catalogue_names_are_unique_and_every_target_exists():
    for kind, known in names().items():
        assert len(known) == len(set(known)) > 10, kind
    assert set(entries("garments", "wraps", Wrap)) == set(group("scarves"))
    drawn = [name for listed in entries("garments", "draws", tuple[str, ...]).values() for name in listed]
    assert set(drawn) == set(wardrobe())
    shapes = entries("faces", "shapes", Shape).values()
    targets = [name for shape in shapes for name in (shape.negative, shape.positive)]
    targets += [name for expression in expressions() for name in units(expression)]
    assert [name for name in targets if not len(makehuman.target(name)[0])] == []
    with pytest.raises(UserError, match=r"a shape of MakeHuman: there is no file .*typo"):
        makehuman.blended({"nose/typo": 1.0})


def test_catalogue_shares_are_probabilities():
    irises = entries("colors", "irises", Iris).values()
    assert sum(iris.light_skin for iris in irises) == pytest.approx(1) == sum(iris.dark_skin for iris in irises)
    for seed in range(20):
        person = sample_person(np.random.default_rng(seed))
        for woman in (False, True):
            odds = style_odds(woman, person)
            assert odds.sum() == pytest.approx(1) and (odds >= 0).all()
            assert shoe_odds(woman, [group("skirts")["pencil skirt"]]).sum() == pytest.approx(1)


@pytest.mark.parametrize("ancestry", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_style_odds_keep_hair_of_one_sex_to_it(ancestry):
    person = replace(sample_person(np.random.default_rng(0)), ancestry=ancestry)
    women, men = ({name for name, p in zip(styles(), style_odds(woman, person)) if p} for woman in (True, False))
    assert women - men == {"bob", "chin length", "long", "wavy long", "bun", "ponytail"}
    assert men - women == {"bald", "shaved", "side part", "quiff"} and ("afro" in women & men) == (ancestry[0] == 1)
