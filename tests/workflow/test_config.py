"""Settings: every preset composes, and a wrong setting is one sentence that names it and what is accepted."""

import shutil
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import asdict, fields, is_dataclass
from itertools import zip_longest

import numpy as np
import pytest
from omegaconf import MISSING, OmegaConf

from relight.core.errors import UserError
from relight.meshes import axes
from relight.panoramas.panorama import LAYOUTS
from relight.settings import Config, Loss, composed, composition, presets, read_preset
from relight.settings.schema import AXES, EXPERIMENT, FIELDS
from relight.settings.setting import Setting, setting_of, type_in_words

# Presets that are composed together: the first of each group, then the second. Those of experiments compose one by one
# in test_plan.py.
ALONE = {group: names for group, names in presets().items() if group != "experiment"}
PRESETS = [[f"{group}={name}" for group, name in zip(ALONE, names) if name] for names in zip_longest(*ALONE.values())]
NEEDS = {"figures=scans": ["figures.folder=x"], "panoramas=folder": ["panoramas.folder=x"]}
NEEDS["augment=photo"] = ["train=photo"]


@pytest.mark.parametrize("words", PRESETS, ids=" ".join)
def test_every_preset_composes(words):
    composed([*words, *(word for preset in words for word in NEEDS.get(preset, []) if word not in words)])


def test_every_setting_is_described_and_conf_has_its_default_and_choices_that_the_code_knows():
    """Defaults of the schema are for files that leave a setting out. They are those of conf/, but for MLflow's, for the
    number of figures, which is the scale's, for the rows, which are the experiment's, and for the weights of losses."""
    cfg = composed()
    for key, item in FIELDS.items():
        assert setting_of(item).about, key
        value = OmegaConf.select(cfg, key)
        assert value is not None or type_in_words(item.type).endswith(", or null"), key
        default = item.default_factory() if item.default is NO_DEFAULT else item.default
        apart = key.startswith(("track.", "figures.count", "sweep.rows", "loss."))
        assert apart or default in (MISSING, value), key
    groups = [group.name for group in fields(Config) if is_dataclass(group.type)]
    settings = [key for group in groups for key in OmegaConf.select(cfg, group)]
    alone = [key for key in FIELDS if "." not in key]
    assert len(settings) + len(alone) == len(FIELDS) and all(setting_of(item).about for item in EXPERIMENT.values())
    assert {*AXES} == {"auto", *axes.AXES} and setting_of(FIELDS["panoramas.layout"]).choices == ("auto", *LAYOUTS)


@pytest.mark.parametrize(("rules", "words", "right", "wrong"), [
    ({}, "", ["", -1, 1e9], []),
    ({"choices": ("a", "b")}, "one of a, b", ["a", "b", ["a"], ["a", "b"]], ["c", "", ["a", "c"], []]),
    ({"least": 1}, "at least 1", [1, 2, [1]], [0, float("nan"), [2, 0], []]),
    ({"above": 0}, "greater than 0", [1e-9], [0, -1, float("nan")]),
    ({"most": 1}, "at most 1", [1, -9], [1.01, float("nan")]),
    ({"below": 1}, "less than 1", [0.99], [1]),
    ({"least": 0, "below": 0.5}, "in [0, 0.5)", [0, 0.49], [0.5, -0.1]),
    ({"above": 0, "most": 1}, "in (0, 1]", [1, 0.01], [0, 1.1]),
    ({"multiple": 64, "least": 64}, "a multiple of 64 and at least 64", [64, 192, [64]], [0, 100, [64, 65]]),
    ({"interval": True}, "", [[0, 0], [-1, 1]], [[1, 0], [1], [], [0, 1, 2]]),
    ({"interval": True, "above": 0}, "greater than 0", [[1, 2]], [[0, 1]]),
])  # fmt: skip
def test_domains(rules, words, right, wrong):
    tested = Setting("", **rules)
    assert tested.domain == words and all(map(tested.allows, [None, *right])) and not any(map(tested.allows, wrong))


def test_no_setting_takes_an_infinity_or_what_overflows():
    kinds = {key: str(item.type) for key, item in FIELDS.items() if "float" in str(item.type)}
    assert len(kinds) > 25
    for key, kind in kinds.items():
        for number in (np.nan, np.inf, -np.inf, 1e300):
            value = {"a": number} if "dict" in kind else [number, number] if "list" in kind else number
            assert not setting_of(FIELDS[key]).allows(value), (key, number)
    for seed in ("split.seed", "lights.seed", "train.seed", "sweep.seeds"):  # k-means takes no larger ones
        assert setting_of(FIELDS[seed]).allows(2**32 - 1) and not setting_of(FIELDS[seed]).allows(2**32), seed


def test_a_preset_is_read_without_hydra():
    cfg = composed(["panoramas.count=0", "panoramas.lamps=3"])  # one kind is enough
    assert asdict(read_preset("lights")) == OmegaConf.to_container(cfg.lights)
    assert read_preset("loss", "full") == Loss(**cfg.loss)
    for name, words in (("bakes", "bakes: no such setting"), ("lights/lab", "lights=lab: no such choice")):
        with pytest.raises(UserError, match=words):
            read_preset(*name.split("/"))


@pytest.mark.parametrize(("override", "words"), [
    ("train.lrr=1", ["train.lrr", "did you mean lr", "steps"]),
    ("train.lr=fast", ["train.lr must be a number, not 'fast'"]),
    ("seed=42", ["seed: no such setting", "did you mean split.seed or lights.seed or train.seed?"]),
    ("train.lr=(1", ["cannot read the override", "in two pairs of quotes"]),
    ("+experiments.claim.compare={nobody against sfsnet: x}", ["experiments.claim.compare", "ROW against ROW"]),
    ("experiments.claim.compare_in=[relit]", ["experiments.claim.compare_in: relit must be", "such as relit_rmse"]),
    ("experiments.claim.shows=[hue]", ["experiments.claim.shows", "one of shading, transport", "hue"]),
    ("~train.lr", ["~train.lr: a setting cannot be removed"]),
    ("sweep.seeds=[]", ["sweep.seeds must be a list of at least one, each in [0, 4294967295], not []"]),
    ("bake.size=100", ["bake.size", "multiple of 64", "100"]),
    ("lights.test=60", ["lights.test", "60", "lights.clusters"]),
    ("train.part=test", ["without ground truth", "loss.albedo", "loss=self_supervised"]),
    ("experiments.claim.rows=[nobody]", ["experiments.claim.rows", "no row nobody"]),
    ("experiment=[table1,table3]", ["experiment=table3: no such choice", "did you mean table2?"]),
    ("sweep.rows.mine=[]", ["there are sfsnet", "to add it, write +sweep.rows.mine=<value>"]),
    ("experiments.table9.rows=[ours_full]", ["experiments.table9: no such setting", "claim"]),
    ("name=a/b", ["name", "a/b"]),
    ("++sweep.rows={x/y: []}", ["sweep.rows", "x/y"]),
    ("+sweep.rows.no_occlusion=[]", ["sweep.rows.no_occlusion has the name of a baseline"]),
    ("++experiments={a b: {rows: []}}", ["experiments", "a b"]),
    ("+train._target_=os.system", ["train._target_", "no such setting"]),
    ("++experiments.claim.plats=true", ["experiments.claim.plats", "did you mean plates"]),
    ("scale=demo,smoke", ["scale=demo,smoke", "relight run -m", "[a,b]"]),
    ("track.uri=${oc.env:HOME}", ["track.uri", "${oc.env:HOME}", "write the value"]),
    ("augment=photo", ["need train.color=photo"]),
    (["bake.supersample=3", "bake.rays=8"], ["bake.supersample=3 needs bake.rays=9 at least"]),
    (["align.up=+z", "align.front=-z"], ["align.up=+z and align.front=-z are the same axis"]),
    ("panoramas.count=0", ["panoramas.count, ", "at least one panorama is needed"]),
    ("train.only=encoder", ["train.only=encoder needs train.start="]),
    (["loss=transport", "loss.transport=0", "loss.tv_transport=0"], ["every weight in the group loss is 0"]),
    ("augment.exposure=[-1,0]", ["need train.color=photo"]),
    ("train.size=64", ["need train.color=photo"]),
    ("augment.exposure=[1,0]", ["augment.exposure must be [least, most]"]),
    (["model=unet", "model.light_head=strided"], ["pooled light head only"]),
    (["model=unet", "model.dropout=0.5"], ["has no dropout"]),
    (["figures=scans", "figures.folder=x", "figures.count=3"], ["count is not read by figures.source=scans"]),
    (["panoramas.layout=ball"], ["panoramas.layout is not read by panoramas.source=generated"]),
    (["panoramas=folder", "panoramas.folder=x", "panoramas.count=9"], ["is not read by panoramas.source=folder"]),
])  # fmt: skip
@pytest.mark.slow
def test_a_wrong_setting_is_one_sentence(override, words):
    with pytest.raises(UserError) as error:
        composed(override if isinstance(override, list) else [override])
    text = str(error.value)
    assert "\n" not in text
    assert all(word in text for word in words), text


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "shift-jis"])
def test_a_preset_in_another_encoding_is_named(tmp_path, monkeypatch, encoding):
    shutil.copytree(composition.CONF, tmp_path / "conf")
    monkeypatch.setattr(composition, "CONF", tmp_path / "conf")
    text, preset = "# @package _global_\n# %s\ntrain:\n  lr: 1e-4\n", tmp_path / "conf" / "scale" / "mine.yaml"
    preset.write_text(text % "Müller が", encoding="utf-8")
    assert composition.composed(["scale=mine"]).train.lr == 1e-4
    preset.write_text(text % ("が" if encoding == "shift-jis" else "Müller"), encoding=encoding)
    with pytest.raises(UserError, match=r"mine\.yaml: save it in UTF-8 without a byte order mark"):
        composition.composed(["scale=mine"])


def test_a_row_of_two_experiments_is_one(tmp_path, monkeypatch):
    shutil.copytree(composition.CONF, tmp_path / "conf")
    monkeypatch.setattr(composition, "CONF", tmp_path / "conf")
    mine = tmp_path / "conf" / "experiment" / "mine.yaml"
    text = "# @package _global_\nsweep: {rows: {ours_full: [loss=%s]}}\nexperiments: {mine: {rows: [ours_full]}}\n"
    mine.write_text(text % "min")
    with pytest.raises(UserError, match=r"experiment=\[\w+,\w+\]: their rows ours_full differ: rename one"):
        composition.composed(["experiment=[table1,table2,mine]"])
    mine.write_text(text % "full" + "model: {width: 1}\n")
    both = composition.composed(["experiment=[silhouette,mine]"])
    assert both.model.width == 1 and {*both.experiments} == {"silhouette", "mine"}


def test_a_file_that_is_no_yaml_is_named_with_the_line(tmp_path):
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "mine.yaml").write_text("width: 1\nname: [ours\nnorm: batch\n")
    with pytest.raises(UserError, match=r"model/mine\.yaml, line 3: .*expected"):
        composed([f"hydra.searchpath=[{tmp_path}]", "model=mine"])


@pytest.mark.parametrize("name", ["relit", "detail", "exclusion", "light"])
def test_no_loss_of_ground_truth_sees_the_test(name):
    words = ["loss=self_supervised", "train.part=test", "train.lights=[test]"]
    composed(words)
    with pytest.raises(UserError, match=f"without ground truth, and loss.{name} uses it"):
        composed([*words, f"loss.{name}=1"])


@pytest.mark.parametrize("words", ["scale=smoke", "experiment=photo figures.outfits=1"])
def test_presets_may_set_what_a_source_does_not_read(words):
    composed(["figures=scans", "figures.folder=x", *words.split()])


def test_one_switch_does_all_that_the_paper_did():
    """Where the scale or a preset says otherwise; what is given by hand stands above it."""
    own, paper = composed(["scale=smoke"]), composed(["scale=smoke", "protocol=paper", "loss=min", "train.lr=1e-3"])
    assert (own.split.kind, own.lights.order, own.lights.split) == ("subject", "cut_first", "room")
    assert (paper.split.kind, paper.lights.order, paper.lights.split) == ("paper", "paper", "random")
    train = paper.train
    assert (train.pairs, train.batch, train.beta1, train.schedule) == ("rows", 1, 0.5, "constant")
    assert (paper.model.norm, paper.loss.tv_reference, paper.loss.shading) == ("instance", paper.bake.size, 0)
    assert (own.model.albedo, paper.model.albedo) == ("straight_through", "clip")
    assert (train.lr, train.steps) == (1e-3, own.train.steps)


@pytest.mark.parametrize("folder", ["a=b, #c", 'it\'s "ä:b"', "back\\", "x/{x}", "1e5"])
def test_folders_may_have_any_sign(folder):
    assert composed([f"figures.folder={folder}", "figures.source=scans"]).figures.folder == folder
