"""The configuration: its schema, its composition, its checks, and the part that each stage reads."""

import difflib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from relight.files import UserError

ROOT = Path(__file__).resolve().parent.parent
IS_CLONE = (ROOT / "Snakefile").exists()  # else relight was installed from a wheel, which holds conf/ in the package
CONF = ROOT / "conf" if IS_CLONE else Path(__file__).resolve().parent / "conf"


@dataclass
class Figures:
    source: str = MISSING  # generated | scans
    folder: str | None = None  # of scans
    first: int = MISSING  # first integer seed
    count: int = MISSING  # how many seeds
    detail: str = MISSING  # draft | full: resolution of the drape
    texture: int = MISSING  # side of the largest baked texture, pixels
    per_subject: int = MISSING  # so many consecutive seeds are one person in one outfit, in different poses
    outfits: int = MISSING  # so many looks of each figure: the same shapes and transport, other fabrics
    sitting: float = MISSING  # 0 to 1: share of the figures that sit
    poses: list[str] = MISSING  # names of which each figure takes one; [] for all
    garments: list[str] = MISSING  # names of all that each figure wears together; [] for any
    hair: list[str] = MISSING  # names of styles of which each figure has one; [] for all
    shading: float = MISSING  # 0 to 1: strength of the shading baked into the albedo, to imitate scans
    device: str = MISSING  # cpu | cuda | auto: where cloth is draped; figures are the same on one kind of device only
    version: int = MISSING  # raised when the code changes results


@dataclass
class Clean:
    component: float = MISSING  # parts with a smaller share of the faces are dropped if they are small and float, too
    close_holes: int = MISSING  # holes of up to so many edges are closed; 0 closes none
    max_faces: int = MISSING  # larger meshes are decimated to this; 0 never
    version: int = MISSING


@dataclass
class Align:
    up: str = MISSING  # auto | +y | +z | -y | ... : the axis of the file that points up
    front: str = MISSING  # auto | +z | -y | ... : the axis of the file that the figure faces
    table: str | None = None  # a CSV with name, up, front, turn (degrees): overrides for single figures
    padding: float = MISSING  # of the image's height, at top and bottom
    version: int = MISSING


@dataclass
class Bake:
    size: int = MISSING  # pixels
    rays: int = MISSING  # per pixel
    order: int = MISSING  # of the spherical harmonics
    bounces: int = MISSING
    supersample: int = MISSING  # k x k places of a pixel, whose mean the maps are
    views: int = MISSING  # of each figure beside the frontal one, to train on
    seed: int = MISSING
    version: int = MISSING


@dataclass
class Split:
    kind: str = MISSING  # subject | paper | disjoint | siblings
    test: float = MISSING  # share of the figures
    sitting: str = MISSING  # apart | dealt: figures that sit are neither trained nor tested on, or like the others
    least: float = MISSING  # the run ends when less than this share of the figures is usable
    seed: int = MISSING


@dataclass
class Panoramas:
    source: str = MISSING  # generated | folder
    folder: str | None = None
    count: int = MISSING  # generated rooms
    skies: int = MISSING  # generated outdoor skies beside them
    seed: int = MISSING
    layout: str = MISSING  # auto, or a layout that relight.panoramas.projection knows
    yaw: float = MISSING  # degrees by which every light is turned, +z toward +x
    flip: bool = MISSING  # mirror left and right
    upside_down: bool = False  # files hold their rows from the bottom up
    repair: bool = False  # pixels that are not finite get the mean of their neighbours; else the file is left out
    version: int = MISSING


@dataclass
class Rules:
    """What makes a light unusual (docs/method.md section 4); "front" is every normal with z > 0, of luminance."""

    bright: float = MISSING  # most irradiance at the front
    channel: float = MISSING  # the same of one channel
    dim: float = MISSING  # least irradiance at (0, 0, 1)
    back: float = MISSING  # most of mean irradiance of the back over that of the front
    toward: float = MISSING  # least share of the main direction toward the camera, for lights with |L1|/L00 > .35
    contrast: float = MISSING  # least of the front's darkest over its brightest irradiance
    first: float = MISSING  # most |L1|/L00
    colour: float = MISSING  # most |ln R/G| and |ln B/G|
    below: float = MISSING  # least elevation of the main direction, degrees, for lights with |L1|/L00 > .35


@dataclass
class Lights:
    order: str = MISSING  # cut_first | paper: order of the chain
    threshold: float = MISSING  # least reference brightness, in the files' own units; 0 keeps all
    low: float = MISSING  # the target of the reference brightness is uniform in [low, high]
    high: float = MISSING
    rotations: int = MISSING
    clusters: int = MISSING
    test: int = MISSING
    split: str = MISSING  # room | random
    veto: str | None = None  # a file with one source (or source:yaw) per line
    rules: Rules = field(default_factory=Rules)
    seed: int = MISSING
    version: int = MISSING


@dataclass
class Model:
    name: str = MISSING  # ours | sfsnet | sfsnet_ao | unet
    width: float = MISSING
    norm: str = MISSING  # instance | batch
    dropout: float = MISSING
    order: int = MISSING
    albedo: str = MISSING  # clip | straight_through | sigmoid: how it is kept in [0,1]
    light_head: str = MISSING  # strided | pooled
    refine: bool = MISSING  # the light is refined to explain the image by the inferred maps
    sees: str = MISSING  # image | mask: shape from the silhouette alone


@dataclass
class Loss:
    albedo: float = MISSING
    transport: float = MISSING
    light: float = MISSING
    tv_albedo: float = MISSING
    tv_transport: float = MISSING
    shading: float = MISSING  # each of the three
    reconstruction: float = MISSING  # each of the six partial combinations
    reconstruction_full: float = MISSING
    detail_albedo: float = MISSING  # energy of the error's detail over that of the truth's
    detail_transport: float = MISSING
    detail_shading: float = MISSING  # under the true light
    tv_reference: int = MISSING  # pixels; the weight of tv_transport is multiplied by size / tv_reference
    reduction: str = MISSING  # image | mask


@dataclass
class Train:
    steps: int = MISSING
    batch: int = MISSING
    lr: float = MISSING
    beta1: float = MISSING
    beta2: float = MISSING
    schedule: str = MISSING  # constant | cosine
    warmup: int = MISSING
    color: str = MISSING  # paper | photo
    seed: int = MISSING
    device: str = MISSING  # auto | cpu | cuda
    precision: str = MISSING  # f32 | bf16
    epoch: int = MISSING  # steps between two lines of log, metrics and checkpoints
    pairs: str = (
        MISSING  # shuffled | rows: (figure, light) pairs at random, or a figure's lights in a row (the authors)
    )
    optimizer: str = MISSING  # adam | adamw
    decay: float = MISSING  # weight decay of adamw
    average: float = (
        MISSING  # decay of the moving average of the weights that is kept at the end; 0 keeps the last ones
    )
    mirror: bool = MISSING  # half of the pairs are mirrored left to right
    compile: bool = MISSING  # torch.compile: pays on a GPU
    start: str | None = None  # a network of the same kind to go on from: a file, or the name of a run of the sweep
    only: str | None = None  # encoder: all else stays as it is in `start`
    part: str = "train"  # train | test: figures of the split; test is for losses that use no truth
    size: int | None = None  # pixels of the images, at most those of the maps; null: those of the maps
    figures: int | None = None  # so many of them at most, drawn from the seed; fewer are part of more; null: all
    lights: list[str] = field(default_factory=lambda: ["train"])  # marks of the light table: train, rich, test
    version: int = MISSING


@dataclass
class Augment:
    """What photographers, cameras and masks do to pictures, drawn anew for each training pair; 0 turns a part off.

    Pixels are those of the network's image. Framing, tint, exposure and recolouring change picture and truth alike, all
    else the picture alone.
    """

    framing: float = MISSING  # share of the pictures that are framed anew
    cut: float = MISSING  # share of these that end between the chest and the knees
    zoom: list[float] = MISSING  # least and most size of the figure, as a factor on the usual framing
    shift: float = MISSING  # of the figure's box from the centre, at most, as a share of the image's side
    tint: float = MISSING  # standard deviation of ln(B/G) of the white balance
    exposure: list[float] = MISSING  # least and most stops
    recolour: float = MISSING  # share of the pictures in which garments get other colours
    prints: float = MISSING  # share of the pictures in which garments get stripes, checks, dots or blots
    mask: int = MISSING  # pixels by which the mask is too fat or too thin, at most, differently along the outline
    tone: float = MISSING  # strength of the tone curve and of changes of saturation
    blur: float = MISSING  # largest standard deviation, pixels
    sharpen: float = MISSING  # largest weight of the unsharp mask
    noise: float = MISSING  # largest standard deviation, as a share of white, of coded values
    jpeg: float = MISSING  # share of the pictures that are compressed, at qualities from 40 to 95


@dataclass
class Evaluate:
    lights: str = MISSING  # test | unusual: which lights of the set relight them; an experiment says so
    device: str = MISSING  # auto | cpu | cuda
    version: int = MISSING
    # What tables and pictures are made with, and no scores: the workflow does not hand it to stages that do not use it.
    bootstrap: int = 2000  # resamples of the figures
    plates: int = 4  # test figures shown in the qualitative figure
    sheet: int = 48  # figures shown in the contact sheet
    seed: int = 0
    figures: str = "test"  # test | sitting | views: which part of the split is scored; an experiment says so


@dataclass
class Trace:
    figures: int = MISSING  # test figures that are path traced
    samples: int = MISSING  # paths per pixel
    bounces: int = MISSING  # of interreflection
    seed: int = MISSING
    version: int = MISSING


@dataclass
class Timing:
    sizes: list[int] = MISSING  # pixels
    seconds: float = MISSING  # spent on each measurement at least
    version: int = MISSING


@dataclass
class Experiment:
    """A question: some runs of the sweep, what they are scored on, and a section of the report."""

    rows: list[str] = MISSING  # runs that the section compares, in order
    title: str = ""  # of its section and table; the experiment's name if empty
    question: str = ""  # what it asks, in a sentence
    figures: str = "test"  # test | sitting | views: on which part of the split
    lights: str = "test"  # test | unusual: under which lights of the set
    axis: str | None = None  # a setting, such as model.width, against which errors are plotted
    table: bool = True  # the rows are trained and scored in a table; false: it has stages of its own
    plates: bool = False  # the rows are shown on test figures side by side


@dataclass
class Sweep:
    runs: dict[str, list[str]] = MISSING  # name of a row -> its overrides
    only: list[str] | None = None  # of the runs; all when not given
    seeds: list[int] = MISSING  # each row is trained once for each of them


@dataclass
class Track:
    uri: str | None = None  # where MLflow keeps the runs: sqlite:///FILE, or the address of a server; null: nowhere
    experiment: str = "relight"  # MLflow's name for what the runs belong to


@dataclass
class Config:
    name: str = MISSING  # of the folder in results/, and of the experiment in MLflow
    figures: Figures = field(default_factory=Figures)
    clean: Clean = field(default_factory=Clean)
    align: Align = field(default_factory=Align)
    bake: Bake = field(default_factory=Bake)
    split: Split = field(default_factory=Split)
    panoramas: Panoramas = field(default_factory=Panoramas)
    lights: Lights = field(default_factory=Lights)
    model: Model = field(default_factory=Model)
    loss: Loss = field(default_factory=Loss)
    train: Train = field(default_factory=Train)
    augment: Augment = field(default_factory=Augment)
    evaluate: Evaluate = field(default_factory=Evaluate)
    trace: Trace = field(default_factory=Trace)
    timing: Timing = field(default_factory=Timing)
    sweep: Sweep = field(default_factory=Sweep)
    experiments: dict[str, Experiment] = field(default_factory=dict)
    track: Track = field(default_factory=Track)


# What each stage may read, groups or single settings: the rest of the tree is not handed to it, so a change there
# cannot matter to it.
READS = {
    "figure": ("figures",),
    "scan": ("figures",),
    "clean": ("clean",),
    "align": ("align",),
    "bake": ("bake",),
    "pack": ("split",),
    "split": ("split",),
    "lights": ("panoramas", "lights", "bake.order"),
    "train": ("model", "loss", "train", "augment", "track"),
    "evaluate": ("evaluate", "track"),
    "baselines": ("evaluate", "train.color", "bake.order"),
    "tables": ("evaluate",),
    "plates": ("evaluate",),
    "sheets": ("evaluate",),
    "viewer": ("name",),
    "light_transfer": ("evaluate",),
    "trace": ("evaluate", "trace", "panoramas", "bake.order", "bake.rays"),
    "path_traced": ("evaluate",),
    "inference_time": ("model", "timing"),
    "report": ("evaluate", "name"),
}

# What a stage reads and its outputs do not depend on: the workflow tells it in other ways or not at all, so that a
# change re-runs nothing.
PASSED_OVER = {
    "train": ("track",),
    "evaluate": ("track", "evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "baselines": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "tables": ("evaluate.plates", "evaluate.sheet"),
    "plates": ("evaluate.bootstrap", "evaluate.sheet", "evaluate.seed"),
    "sheets": ("evaluate.bootstrap", "evaluate.plates", "evaluate.seed"),
    "trace": ("evaluate.bootstrap", "evaluate.plates", "evaluate.sheet", "evaluate.seed"),
    "light_transfer": ("evaluate.sheet",),
    "path_traced": ("evaluate.sheet",),
}


def composed(overrides: Iterable[str] = ()) -> DictConfig:
    """The whole tree under conf/ with Hydra overrides, resolved and checked.

    Raises UserError in one line that names the setting and what is accepted.
    """
    from hydra import compose, initialize_config_dir  # half a second, which inference can do without
    from hydra.core.config_store import ConfigStore
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    if not CONF.is_dir():
        raise UserError(f"there is no folder {CONF}: the workflow and its stages run from a clone of the repository")
    overrides = list(overrides)
    ConfigStore.instance().store(name="schema", node=Config)
    try:
        for text, override in zip(overrides, OverridesParser.create().parse_overrides(overrides)):
            if override.is_sweep_override():
                raise UserError(f"{text} is several values: `relight run -m` tries each; one setting's list is [a,b]")
        with initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = compose("config", overrides=overrides)
        check(resolved(cfg))
    except (HydraException, OmegaConfBaseException, yaml.YAMLError) as error:
        raise UserError(explain(error, overrides)) from None
    return cfg


def resolved(cfg: DictConfig) -> DictConfig:
    """`cfg` with the values of its references. Raises UserError for ${oc.env:...} and the like.

    Settings come from people and files that one may not know; the environment holds secrets, and what is resolved is
    written to results and to MLflow.
    """
    for key, value in flat(OmegaConf.to_container(cfg)).items():
        if call := re.search(r"\$\{\s*[\w.]+\s*:.*?\}", str(value)):
            raise UserError(f"{key}: {call[0]} is not looked up in settings; write the value itself")
    OmegaConf.resolve(cfg)
    return cfg


# What augments pictures, beside augment.exposure: with each at 0 they stay as they were relit.
STRENGTHS = [
    f"augment.{name}"
    for name in ("framing", "tint", "recolour", "prints", "mask", "tone", "blur", "sharpen", "noise", "jpeg")
]
LEAST = {
    **dict.fromkeys([*STRENGTHS, "augment.cut", "augment.shift"], 0),
    **{f"loss.{weight.name}": 0 for weight in fields(Loss) if weight.type is float},
    "figures.count": 1,
    "figures.texture": 16,
    "figures.per_subject": 1,
    "figures.outfits": 1,
    "bake.size": 64,
    "bake.rays": 1,
    "bake.order": 1,
    "bake.bounces": 0,
    "bake.supersample": 1,
    "bake.views": 0,
    "panoramas.count": 0,
    "lights.rotations": 1,
    "lights.clusters": 2,
    "lights.test": 1,
    "model.width": 0.01,
    "train.steps": 1,
    "train.batch": 1,
    "train.figures": 1,
    "train.size": 64,
    "train.epoch": 1,
    "evaluate.bootstrap": 1,
    "trace.figures": 1,
    "trace.samples": 2,
    "trace.bounces": 0,
}
CHOICES = {
    "figures.source": ("generated", "scans"),
    "figures.detail": ("draft", "full"),
    "figures.device": ("cpu", "cuda", "auto"),
    "split.sitting": ("apart", "dealt"),
    "split.kind": ("subject", "paper", "disjoint", "siblings"),
    "panoramas.source": ("generated", "folder"),
    "lights.order": ("cut_first", "paper"),
    "lights.split": ("room", "random"),
    "model.name": ("ours", "sfsnet", "sfsnet_ao", "unet"),
    "model.norm": ("instance", "batch"),
    "model.albedo": ("clip", "straight_through", "sigmoid"),
    "model.light_head": ("strided", "pooled"),
    "model.sees": ("image", "mask"),
    "loss.reduction": ("image", "mask"),
    "evaluate.lights": ("test", "unusual"),
    "evaluate.figures": ("test", "sitting", "views"),
    "evaluate.device": ("auto", "cpu", "cuda"),
    "train.schedule": ("constant", "cosine"),
    "train.color": ("paper", "photo"),
    "train.device": ("auto", "cpu", "cuda"),
    "train.precision": ("f32", "bf16"),
    "train.pairs": ("shuffled", "rows"),
    "train.optimizer": ("adam", "adamw"),
    "train.only": ("encoder",),
    "train.part": ("train", "test"),
}
TRUTH = ("albedo", "transport", "light", "shading", "reconstruction")  # losses that compare with more than the picture
EXPERIMENT = {"figures": ("test", "sitting", "views"), "lights": ("test", "unusual")}
RULES = {
    "figures.sitting": (lambda value: 0 <= value <= 1, "must lie in [0, 1]"),
    "figures.shading": (lambda value: 0 <= value <= 1, "must lie in [0, 1]"),
    "bake.size": (lambda value: value % 64 == 0, "must be a multiple of 64"),
    "train.size": (lambda value: value % 64 == 0, "must be a multiple of 64"),
    "train.lr": (lambda value: value > 0, "must be greater than 0"),
    "train.lights": (
        lambda value: value and set(value) <= {"train", "rich", "test"},
        "must be a list of some of train, rich, test",
    ),
    "augment.zoom": (lambda value: len(value) == 2 and 0 < value[0] <= value[1], "must be [least, most] above 0"),
    "augment.exposure": (lambda value: len(value) == 2 and value[0] <= value[1], "must be [least, most], in stops"),
    "split.test": (lambda value: 0 < value < 1, "must lie between 0 and 1"),
    "split.least": (lambda value: 0 <= value <= 1, "must lie in [0, 1]"),
    "align.padding": (lambda value: 0 <= value < 0.5, "must lie in [0, 0.5)"),
    "timing.sizes": (
        lambda value: len(value) > 0 and all(size > 0 and size % 64 == 0 for size in value),
        "must be multiples of 64",
    ),
    "model.dropout": (lambda value: 0 <= value < 1, "must lie in [0, 1)"),
}
NAME, LONGEST = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._+-]*"), 100


def check_name(what: str, name: str) -> None:
    """Refuses a name that is not safe in paths and in commands. Raises UserError."""
    if not NAME.fullmatch(str(name)) or len(str(name)) > LONGEST:
        raise UserError(
            f"{what}: {str(name)!r} is no name: up to {LONGEST} letters, digits, '_', '.', '+' and '-', none of the "
            "last three first"
        )


def strays(cfg: DictConfig, above: str = "") -> Iterator[str]:
    """Sentences about settings that the schema does not have: Hydra adds what an override with + asks for."""
    known = getattr(OmegaConf.get_type(cfg), "__dataclass_fields__", None)
    for key in cfg:
        if known is not None and key not in known:
            yield no_such(f"{above}{key}", known)
        elif not OmegaConf.is_missing(cfg, key) and isinstance(cfg[key], DictConfig):
            yield from strays(cfg[key], f"{above}{key}.")


def no_such(key: str, known: Iterable[str]) -> str:
    """Says that there is no setting `key`, and which there are in its place."""
    close = difflib.get_close_matches(key.rpartition(".")[2], known, 1)
    hint = f"did you mean {close[0]}? " if close else ""
    return f"{key}: no such setting; {hint}there are {', '.join(known)}"


def check(cfg: DictConfig) -> None:
    """Refuses values that have the right type but make no sense; a stage's unset groups pass. Raises UserError."""

    def get(key: str) -> Any:
        return OmegaConf.select(cfg, key)

    for sentence in strays(cfg):
        raise UserError(sentence)
    for key, names in (("name", [get("name")]), ("sweep.runs", get("sweep.runs")), ("experiments", get("experiments"))):
        for name in names or ():
            if name is not None:
                check_name(key, name)
    for key, bound in LEAST.items():
        if get(key) is not None and get(key) < bound:
            raise UserError(f"{key} must be at least {bound}, not {get(key)}")
    for key, known in CHOICES.items():
        if get(key) is not None and get(key) not in known:
            raise UserError(f"{key} must be one of {', '.join(known)}, not {get(key)}")
    for key, (holds, words) in RULES.items():
        if get(key) is not None and not holds(get(key)):
            raise UserError(f"{key} {words}, not {get(key)}")
    if get("lights.low") is not None and get("lights.low") > get("lights.high"):
        raise UserError(f"lights.low {get('lights.low')} must not be above lights.high {get('lights.high')}")
    if get("lights.test") is not None and get("lights.test") >= get("lights.clusters"):
        raise UserError(f"lights.test {get('lights.test')} must be below lights.clusters {get('lights.clusters')}")
    if get("train.color") == "paper" and (
        get("train.size") or any([*map(get, STRENGTHS), *(get("augment.exposure") or ())])
    ):
        raise UserError("augment and train.size make pictures as cameras do: they need train.color=photo")
    if get("model.name") == "unet" and get("model.light_head") == "strided":
        raise UserError("model.name=unet has a pooled light head only: give model=unet or model.light_head=pooled")
    if get("train.part") == "test" or "test" in (get("train.lights") or ()):
        if used := [name for name in TRUTH if get(f"loss.{name}")]:
            raise UserError(
                f"to train on the test's pictures, no truth may be used: loss.{used[0]} does, loss=self_supervised not"
            )
    for name, experiment in (get("experiments") or {}).items():
        for key, known in EXPERIMENT.items():
            if experiment[key] not in known:
                raise UserError(f"experiments.{name}.{key} must be one of {', '.join(known)}, not {experiment[key]}")
        if unknown := [row for row in experiment.rows if row not in (get("sweep.runs") or {})]:
            raise UserError(f"experiments.{name}.rows: no run {unknown[0]} in sweep.runs; add it there")
    if (get("figures.outfits") or 1) > 1 and (get("figures.source") == "scans" or get("bake.bounces")):
        raise UserError("figures.outfits must be 1 for scans, and with bake.bounces: light bounces off other albedo")
    for group, source in (("figures", "scans"), ("panoramas", "folder")):
        if get(f"{group}.source") == source and not get(f"{group}.folder"):
            raise UserError(f"{group}.source={source} needs {group}.folder=<the folder to read>")


def view(cfg: DictConfig, stage: str) -> dict[str, Any]:
    """The part of the tree that a stage's outputs depend on, as plain values."""
    part = OmegaConf.create()
    for key in READS[stage]:
        OmegaConf.update(part, key, OmegaConf.select(cfg, key))
    plain = OmegaConf.to_container(part, resolve=True)
    for key in PASSED_OVER.get(stage, ()):
        group, _, name = key.partition(".")
        plain[group].pop(name) if name else plain.pop(group)
    return plain


def explain(error: Exception, overrides: Iterable[str] = ()) -> str:
    """Hydra's and OmegaConf's errors as one line that names the setting and what is accepted."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark:
        return f"{error.problem_mark.name}, line {error.problem_mark.line + 1}: {error.problem}"
    chain, link = [], error
    while link is not None:
        chain.append(str(link))
        link = link.__cause__ or link.__context__
    text = "\n".join(chain)
    if match := re.search(r"Key '([^']+)' (?:is )?not in '(\w+)'", text):
        key, owner = match.groups()
        full = re.search(r"full_key: ([\w.]+)", text)
        known = list(globals()[owner].__dataclass_fields__) if owner in globals() else []
        return no_such(full[1] if full else key, known)
    if match := re.search(r"Value '(.*?)'(?: of type '\w+')? could not be converted to (\w+)", text):
        full = re.search(r"full_key: ([\w.]+)", text)
        return f"{full[1] if full else 'a setting'}: {match[1]!r} is not of type {match[2]}"
    if match := re.search(r"Could not find '([^']+)'.*?Available options in '([^']+)':\s*(.*?)(?:\n\S|\Z)", text, re.S):
        options = ", ".join(match[3].split())
        return f"{match[1].replace('/', '=')}: no such choice; {match[2]} is one of {options}"
    if match := re.search(r"Could not override '([^']+)'\.\s*No match in the defaults list", text):
        return f"{match[1]}: no such group of settings; there are {', '.join(Config.__dataclass_fields__)}"
    if re.search("no viable alternative|LexerNoViableAlt|mismatched input|extraneous input|token recognition", text):
        return f"cannot read the overrides {' '.join(overrides)!r}: write key=value, lists as key=[a,b]"
    return " ".join(text.split("\n")[0].split())


def flat(tree: dict, prefix: str = "") -> dict[str, Any]:
    """{"a": {"b": 1}} as {"a.b": 1}."""
    out = {}
    for key, value in tree.items():
        out.update(flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value})
    return out
