"""The schema: every setting with its type, description and domain. Default values are in conf/."""

from collections.abc import Iterator
from dataclasses import Field, dataclass, field, fields, is_dataclass
from typing import Any

from relight import extensions
from relight.settings.scores import PRINTED, QUANTITIES
from relight.settings.setting import setting

DEVICES = ("auto", "cpu", "cuda")
PARTS = ("test", "sitting")  # parts of the split that can be scored
SCORED_LIGHTS = ("test", "unusual")  # splits of the light set that can be scored under
MAX_SEED, MAX_WEIGHT = 2**32 - 1, 1_000_000
AXES = ("auto", "+x", "-x", "+y", "-y", "+z", "-z")


def weight(about: str, teaches: str, supervised: bool = True) -> Any:
    """Returns a field for the weight of a loss, 0 by default.

    Args:
        about: what the loss measures.
        teaches: the outputs that it constrains, as in "albedo light".
        supervised: whether it needs ground truth.
    """
    return setting(about, 0.0, least=0, most=MAX_WEIGHT, supervised=supervised, teaches=tuple(teaches.split()))


@dataclass
class Figures:
    """The source and the content of figures."""

    source: str = setting("where they come from", choices=("generated", "scans", *extensions.names()))
    folder: str | None = setting("folder of the scans", None)
    first: int = setting("first seed", 0, least=0, unread="scans")
    count: int = setting("number of seeds", 1, least=1, unread="scans")
    detail: str = setting("resolution of the drape", choices=("draft", "full"), unread="scans")
    texture: int = setting("side of the largest texture, pixels", least=64, unread="scans")
    per_subject: int = setting(
        "number of consecutive seeds that show one person in one outfit, posed anew", least=1, unread="scans"
    )
    outfits: int = setting("number of sets of fabrics of each figure, with the same shape and transport", least=1)
    sitting: float = setting("share of the figures that sit", least=0, most=1, unread="scans")
    poses: list[str] = setting("names of the poses to draw from; [] for all", unread="scans")
    garments: list[str] = setting("names of garments that every figure wears; [] for any", unread="scans")
    hair: list[str] = setting("names of the hair styles to draw from; [] for all", unread="scans")


@dataclass
class Align:
    """Alignment of meshes: upright, facing the camera, filling the image."""

    up: str = setting("axis of the file that points up", "auto", choices=AXES)
    front: str = setting("axis of the file that the figure faces", "auto", choices=AXES)
    table: str | None = setting("CSV table of single figures: name, up, front, turn (degrees)", None)


@dataclass
class Bake:
    """Maps of figures, by ray casting."""

    size: int = setting("side of the maps, pixels", least=64, most=8192, multiple=64)
    rays: int = setting("rays per pixel: transport has an RMS error of 5e-3 with 256; 64 are for drafts", least=1)
    order: int = setting("order of the spherical harmonics; the paper has 2, nine coefficients", least=2, most=30)
    bounces: int = setting("number of bounces of interreflection; the paper has none", least=0)
    supersample: int = setting("k: maps are means over k x k points of a pixel, which share its rays", least=1)
    views: int = setting("number of further views of each figure, rotated and in perspective, to train on", least=0)


@dataclass
class Split:
    """Division of the figures into training, validation and test."""

    kind: str = setting("what is drawn: whole subjects, or single figures (paper)", choices=("subject", "paper"))
    test: float = setting("share of the figures that are test figures", above=0, below=1)
    sitting: str = setting("sitting figures: a part of their own, or dealt out", choices=("apart", "dealt"))
    least: float = setting("least share of usable figures, below which the run ends", least=0, most=1)
    seed: int = setting("seed of the draw", least=0, most=MAX_SEED)


@dataclass
class Panoramas:
    """The source of the lights."""

    source: str = setting("generated panoramas, or the files of a folder", choices=("generated", "folder"))
    folder: str | None = setting("folder of panoramas, with subfolders", None)
    count: int = setting("number of generated rooms", least=0, kind="room", unread="folder")
    skies: int = setting("number of generated skies", 0, least=0, kind="sky", unread="folder")
    lamps: int = setting("number of generated studios with lamps", 0, least=0, kind="lamps", unread="folder")
    layout: str = setting(
        "layout of the files; auto detects it by metadata and aspect ratio",
        choices=("auto", "latlong", "angular", "ball", "cross", "strip", "strip-gl"),
        unread="generated",
    )
    flip: bool = setting("whether panoramas are mirrored left to right")
    repair: bool = setting(
        "whether pixels that are not finite get the mean of their neighbours; else refused", False, unread="generated"
    )


@dataclass
class Lights:
    """The light set: how lights of panoramas are scaled, rotated, selected and split."""

    order: str = setting("unusual lights go before the clustering, or after it", choices=("cut_first", "paper"))
    clusters: int = setting("number of usual lights", least=2)
    test: int = setting("number of usual test lights, fewer than clusters", least=1)
    extra_test: int = setting("number of further test lights, from panoramas without training lights", least=0)
    split: str = setting("split of training and test lights: by panorama, or at random", choices=("room", "random"))
    rules: str = setting("limits of usual lights: of rooms, or wider, for skies too", choices=("rooms", "strong"))
    seed: int = setting("seed of scales, clusters and split", least=0, most=MAX_SEED)


@dataclass
class Model:
    """The network."""

    name: str = setting("architecture", choices=("ours", "sfsnet", "sfsnet_ao", "unet", *extensions.names()))
    width: float = setting("factor on the number of channels of every layer", least=0.01, most=16)
    norm: str = setting("normalisation by the statistics of each image, or of the batch", choices=("instance", "batch"))
    dropout: float = setting("share of features that are zeroed in training", least=0, below=1)
    order: int = setting("order of the inferred transport and light", least=2)
    albedo: str = setting("how albedo is limited to [0, 1]", choices=("clip", "straight_through"))
    light_head: str = setting("head of the light: strided, or pooled over the figure", choices=("strided", "pooled"))
    refine: bool = setting("whether the light is refined to explain the image by the inferred maps")
    rescale: float = setting("exponent of the image's factor on the refined light, at inference", 0.0, least=0, most=1)
    rebalance: float = setting("exponent of the light's color on the image, at inference", 0.0, least=0, most=1)
    sees: str = setting("input: the image and its mask, or the mask alone", choices=("image", "mask"))


@dataclass
class Loss:
    """Weights of the losses of `relight.learning.losses.TERMS`; a loss of weight 0 is not computed."""

    albedo: float = weight("error of albedo", "albedo")
    transport: float = weight("error of transport, or of normals and AO for networks that infer these", "transport")
    light: float = weight("error of the light", "light")
    tv_albedo: float = weight("total variation of albedo", "albedo", supervised=False)
    tv_transport: float = weight("total variation of transport", "transport", supervised=False)
    shading: float = weight(
        "errors of shading by inferred transport, light, and both; weight of each", "transport light"
    )
    reconstruction: float = weight(
        "errors of the image with one or two of three factors inferred; weight of each of six", "albedo transport light"
    )
    reconstruction_full: float = weight(
        "error of the relit image with all three inferred", "albedo transport light", supervised=False
    )
    relit: float = weight("errors of shading and image under another light; weight of each", "albedo transport")
    detail: float = weight(
        "fine detail of the errors in albedo, transport and shading, relative to the truth's; one weight for each",
        "albedo transport",
    )
    exclusion: float = weight("detail common to albedo and shading, beyond that of the true ones", "albedo transport")
    extra: dict[str, float] = setting(
        "weights of your own losses, by the names of the extensions", {}, least=0, most=MAX_WEIGHT
    )
    tv_reference: int = setting("side, pixels, at which tv_transport has its weight; in proportion", 1024, least=1)
    reduction: str = setting("means over the whole image, or over its mask", "image", choices=("image", "mask"))


@dataclass
class Train:
    """One training."""

    steps: int = setting("number of steps", least=1)
    batch: int = setting("pairs of figure and light per step", least=1)
    lr: float = setting("learning rate of Adam; Muon takes five times as much", above=0, most=10)
    beta1: float = setting("decay of Adam's mean of gradients", least=0, below=1)
    schedule: str = setting("schedule of the learning rate after the warm-up", choices=("constant", "cosine"))
    span: list[float] = setting(
        "part of the cosine schedule that this training runs, from and to", [0.0, 1.0], interval=True, least=0, most=1
    )
    warmup: int = setting("steps in which the learning rate rises to lr", least=0)
    color: str = setting(
        "paper: sRGB codes taken as linear; photo: linear light, as a camera records it", choices=("paper", "photo")
    )
    seed: int = setting("seed of weights, pairs and augmentation", least=0, most=MAX_SEED)
    device: str = setting("device of the training; auto prefers a GPU, as scores do", choices=DEVICES)
    precision: str = setting("precision of matrix products: 32 bits, or bfloat16", choices=("f32", "bf16"))
    epoch: int = setting("steps between metrics and checkpoints", least=1)
    pairs: str = setting("pairs at random, or all lights of a figure in a row", choices=("shuffled", "rows"))
    optimizer: str = setting("Adam, or Muon for convolutions with a norm", choices=("adam", "muon"))
    average: float = setting("decay of the average of the weights that is saved; 0: the last", least=0, below=1)
    mirror: bool = setting("whether half of the pairs are mirrored left to right")
    compile: bool = setting("whether the network is compiled by torch.compile, which is faster on a GPU")
    start: str | None = setting("network of the same form to start from: a file, or another row", None)
    only: str | None = setting("part of `start` that is trained; null for all of it", None, choices=("encoder",))
    part: str = setting("part of the split; test needs losses without ground truth", "train", choices=("train", "test"))
    size: int | None = setting("side of the images, pixels; null for that of the maps", None, least=64, multiple=64)
    figures: int | None = setting("number of training figures, nested by the seed; null for all", None, least=1)
    lights: list[str] = setting(
        "splits of the lights; test needs losses without ground truth", ["train"], choices=("train", "rich", "test")
    )


@dataclass
class Augment:
    """Random changes as by photographers, cameras and masks, drawn for each training pair; 0 turns one off.

    Pixels are those of the network's image. Framing, tint, exposure, recoloring and prints change both picture and
    ground truth, the others only the picture.
    """

    framing: float = setting("share of the pictures with a new framing, half of them cut", least=0, most=1)
    tint: float = setting("standard deviation of ln(B/G) of the white balance", least=0, most=3)
    exposure: list[float] = setting("range of the exposure, stops", interval=True, least=-8, most=8)
    recolor: float = setting("share of the pictures with other colors of garments", least=0, most=1)
    prints: float = setting("share of the pictures with stripes, checks, dots or blots on garments", least=0, most=1)
    gloss: float = setting("share of the pictures with glossy materials", least=0, most=1)
    mask: int = setting("largest error of the mask's outline, pixels", least=0)
    camera: float = setting("strength of blur, tone curve, sharpening, noise and JPEG compression", least=0, most=1)


# The settings of Augment that change pictures, apart from `exposure`.
STRENGTHS = ("framing", "tint", "recolor", "prints", "gloss", "mask", "camera")
NO_AUGMENTATION = Augment(**dict.fromkeys(STRENGTHS, 0), exposure=[0.0, 0.0])


@dataclass
class Experiment:
    """A question, the rows that answer it, and its section of the report."""

    rows: list[str] = setting("rows that the section compares, in order")
    title: str = setting("title of its section and table; the experiment's name if empty", "")
    question: str = setting("the question, in a sentence", "")
    about: str = setting("a paragraph for its section: what is compared, and why", "")
    figures: str = setting("part of the split on which its rows are scored", "test", choices=PARTS)
    lights: str = setting("split of the light set under which they are scored", "test", choices=SCORED_LIGHTS)
    plates: bool = setting("whether its rows are drawn side by side on test figures", False)
    shows: list[str] = setting("quantities in its table", list(PRINTED), choices=tuple(QUANTITIES))
    labels: dict[str, str] = setting("labels of its rows in tables and pictures, by row; else their names", {})
    compare: dict[str, str] = setting("pairs of rows, `this against that`, each with what the difference measures", {})
    compare_in: list[str] = setting(
        "columns of the scores in which they are compared",
        ["shading_rmse", "transport_rmse", "albedo_rmse", "light_rmse"],
    )


@dataclass
class Sweep:
    """The rows to train, to which presets of `experiment` add."""

    rows: dict[str, list[str]] = setting("overrides of each row, by name", {})
    only: list[str] | None = setting("names of the rows to train; null for all", None)
    seeds: list[int] = setting("seeds, with each of which every row is trained", [0], least=0, most=MAX_SEED)


@dataclass
class Track:
    """Tracking in MLflow."""

    uri: str | None = setting("store of the runs: sqlite:///FILE, a database or a server; null for none", None)
    experiment: str = setting("name of the experiment in MLflow", "relight")


@dataclass
class Config:
    """All settings.

    A group has its values in conf/<group>/. `relight.lab.record.ROW_GROUPS` names those that rows may change.
    """

    name: str = setting("name of the folder in results/")
    data: str | None = setting("name of another run whose figures and lights are taken; null to make them", None)
    figures: Figures = field(default_factory=Figures)
    align: Align = field(default_factory=Align)
    bake: Bake = field(default_factory=Bake)
    split: Split = field(default_factory=Split)
    panoramas: Panoramas = field(default_factory=Panoramas)
    lights: Lights = field(default_factory=Lights)
    model: Model = field(default_factory=Model)
    loss: Loss = field(default_factory=Loss)
    train: Train = field(default_factory=Train)
    augment: Augment = field(default_factory=Augment)
    sweep: Sweep = field(default_factory=Sweep)
    experiments: dict[str, Experiment] = field(default_factory=dict)
    track: Track = field(default_factory=Track)


def fields_by_key(schema: type, above: str = "") -> Iterator[tuple[str, Field[Any]]]:
    """Yields (key, field) for each setting of a schema, including those of nested groups.

    Args:
        schema: a dataclass of settings or groups, such as `Config`.
        above: text before the keys; with "train." the keys of `Train` are such as `train.lr`.
    """
    for item in fields(schema):
        if isinstance(item.type, type) and is_dataclass(item.type):
            yield from fields_by_key(item.type, f"{above}{item.name}.")
        elif "setting" in item.metadata:
            yield f"{above}{item.name}", item


FIELDS = dict(fields_by_key(Config))
EXPERIMENT = dict(fields_by_key(Experiment))  # the fields of each experiment


def field_of(key: str) -> Field[Any] | None:
    """Returns the field of a setting, such as `train.lr` or `experiments.table1.rows`, or None."""
    group, _, rest = key.partition(".")
    return EXPERIMENT.get(rest.partition(".")[2]) if group == "experiments" else FIELDS.get(key)
