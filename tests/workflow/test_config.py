"""Settings: every choice composes, and a wrong one is told in one line that names it and what is accepted."""

from dataclasses import fields

import pytest
from omegaconf import OmegaConf

from relight.config import CHOICES, CONF, LEAST, READS, RULES, Config, check, composed, view
from relight.files import UserError

GROUPS = sorted(path.name for path in CONF.iterdir() if path.is_dir() and any(path.iterdir()))
OPTIONS = [f"{group}={path.stem}" for group in GROUPS for path in sorted((CONF / group).glob("*.yaml"))]
NEEDS = {
    "augment=photo": ["train=photo"],
    "figures=scans": ["figures.folder=x"],
    "panoramas=folder": ["panoramas.folder=x"],
}


@pytest.mark.parametrize("option", OPTIONS)
def test_every_choice_composes(option):
    composed([option, *NEEDS.get(option, [])])


@pytest.mark.parametrize("key", [*LEAST, *CHOICES, *RULES])
def test_checks_name_existing_settings(key):
    owner = {field.name: field.type for field in fields(Config)}
    group, _, name = key.partition(".")
    assert group in owner and (not name or name in owner[group].__dataclass_fields__)


@pytest.mark.parametrize("stage", READS)
def test_what_stages_read_is_there(stage):
    cfg = composed()
    assert all(OmegaConf.select(cfg, key) is not None for key in READS[stage])


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("train.lrr=1", ["train.lrr", "did you mean lr", "steps"]),
        ("train.lr=fast", ["train.lr", "'fast'", "Float"]),
        ("loss=ful", ["loss=ful", "full", "min"]),
        ("los=full", ["los", "loss"]),
        ("+extra=1", ["extra", "train"]),
        ("train=[", ["train=[", "key=value"]),
        ("bake.size=100", ["bake.size", "multiple of 64", "100"]),
        ("bake.rays=0", ["bake.rays", "at least 1"]),
        ("figures.source=scans", ["figures.folder"]),
        ("model.norm=group", ["model.norm", "instance, batch", "group"]),
        ("lights.test=60", ["lights.test", "60", "lights.clusters"]),
        ("train.lights=[dim]", ["train.lights", "train, rich, test", "dim"]),
        ("train.part=test", ["no truth", "loss.albedo", "loss=self_supervised"]),
        ("train.lights=[train,test]", ["no truth", "loss.albedo"]),
        ("experiments.table1.rows=[nobody]", ["experiments.table1.rows", "no run nobody"]),
        ("experiments.table1.figures=lying", ["experiments.table1.figures", "sitting", "lying"]),
        ("name=a/b", ["name", "a/b"]),
        ("name=..", ["name", "'..'"]),
        ("name=.", ["name", "'.'"]),
        ("name=-x", ["name", "'-x'"]),
        ("name=", ["name", "''"]),
        ("++sweep.runs={x/y: []}", ["sweep.runs", "x/y"]),
        ("++sweep.runs={$x: []}", ["sweep.runs", "$x"]),
        ("++experiments={a b: {rows: []}}", ["experiments", "a b"]),
        ("+train.foo=1", ["train.foo", "no such setting", "steps"]),
        ("+train._target_=os.system", ["train._target_", "no such setting"]),
        ("+lights.rules.brigth=1", ["lights.rules.brigth", "did you mean bright"]),
        ("++experiments.table1.tabel=false", ["experiments.table1.tabel", "did you mean table"]),
        ("loss.shading=-1", ["loss.shading", "at least 0", "-1"]),
        ("loss.tv_albedo=-0.1", ["loss.tv_albedo", "at least 0"]),
        ("scale=demo,smoke", ["scale=demo,smoke", "relight run -m", "[a,b]"]),
        ("train.lr=interval(0,1)", ["train.lr=interval(0,1)", "relight run -m"]),
        ("track.uri=${oc.env:HOME}", ["track.uri", "${oc.env:HOME}", "write the value"]),
        ("figures.folder='x${oc.decode:1}'", ["figures.folder", "oc.decode"]),
        ("scale=huge", ["scale=huge", "demo", "smoke"]),
    ],
)
def test_wrong_settings_are_told_in_one_line(override, words):
    with pytest.raises(UserError) as error:
        composed([override])
    text = str(error.value)
    assert "\n" not in text
    assert all(word in text for word in words), text


def test_view_hands_over_what_is_read():
    cfg = composed(["train.lr=0.5"])
    assert set(view(cfg, "bake")) == {"bake"}
    assert view(cfg, "train")["train"]["lr"] == 0.5


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["augment=photo"], "need train.color=photo"),
        (["train.size=64"], "need train.color=photo"),
        (["model=unet", "model.light_head=strided"], "pooled light head only"),
        (["augment.zoom=[1.2,0.8]"], "augment.zoom must be"),
        (["augment.noise=-1"], "augment.noise must be at least 0"),
    ],
)
def test_settings_for_photographs_are_checked(words, said):
    with pytest.raises(UserError, match=said):
        composed(words)


def test_a_stage_that_reads_no_augmentation_is_not_asked_for_one():
    check(OmegaConf.merge(OmegaConf.structured(Config), {"train": {"color": "paper"}}))
