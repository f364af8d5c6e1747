"""The schema: every setting with its type, what it means, and which values it may have. Default values are in conf/."""

from collections.abc import Iterator
from dataclasses import Field, dataclass, field, fields, is_dataclass
from typing import Any

from relight import extensions
from relight.config.setting import setting

DEVICES = ("auto", "cpu", "cuda")
PARTS = ("test", "sitting", "views")  # of the split, to score
SCORED_LIGHTS = ("test", "unusual")  # of the light set, to score under
AXES = ("auto", "+x", "-x", "+y", "-y", "+z", "-z")
VERSION = "version of the code; raised when it changes results, which are then made anew"


@dataclass
class Figures:
    """Where figures come from, and what they are like."""

    source: str = setting(
        "generated figures, scans: the meshes of a folder, or olat: captures of a light stage, one light at a time",
        choices=("generated", "scans", "olat", *extensions.names()),
    )
    folder: str | None = setting("folder of the scans or captures", None)
    only: str = setting("regular expression for the names of captures; empty for all", "")
    first: int = setting("first seed", 0, least=0)
    count: int = setting("number of seeds", 1, least=1)
    detail: str = setting("resolution of the drape", choices=("draft", "full"))
    texture: int = setting("side of the largest texture, pixels", least=16)
    per_subject: int = setting("consecutive seeds that are one person in one outfit, in different poses", least=1)
    outfits: int = setting("sets of fabrics of each figure, on the same shapes and with the same transport", least=1)
    sitting: float = setting("share of the figures that sit", least=0, most=1)
    poses: list[str] = setting("names of poses of which each figure takes one; [] for all")
    garments: list[str] = setting("names of garments that each figure wears together; [] for any")
    hair: list[str] = setting("names of hair styles of which each figure has one; [] for all")
    shading: float = setting("strength of the shading baked into the albedo, to imitate scans", least=0, most=1)
    device: str = setting(
        "where cloth is draped; figures are the same only on devices of one kind", choices=("cpu", "cuda", "auto")
    )
    version: int = setting(VERSION, least=0)


@dataclass
class Clean:
    """Repair of meshes."""

    component: float = setting(
        "floating parts with a smaller share of the faces are dropped if they are small, too", least=0, most=1
    )
    close_holes: int = setting("largest hole that is closed, edges; 0 closes none", least=0)
    max_faces: int = setting("larger meshes are decimated to so many faces; 0 decimates none", least=0)
    version: int = setting(VERSION, least=0)


@dataclass
class Align:
    """Meshes before the camera: upright, facing it, filling the image."""

    up: str = setting("axis of the file that points up", choices=AXES)
    front: str = setting("axis of the file that the figure faces", choices=AXES)
    table: str | None = setting("CSV with the columns name, up, front and turn (degrees), for single figures", None)
    padding: float = setting("margin at each edge, as a share of the image", least=0, below=0.5)
    version: int = setting(VERSION, least=0)


@dataclass
class Bake:
    """Maps of figures, by ray casting."""

    size: int = setting("side of the maps, pixels", least=64, multiple=64)
    rays: int = setting("rays per pixel: 256 give transport an RMS error of 5e-3, 64 are for drafts", least=1)
    order: int = setting("order of the spherical harmonics; the paper's is 2, nine coefficients", least=1)
    bounces: int = setting("bounces of interreflection; the paper has none", least=0)
    supersample: int = setting("k, where maps are means over k x k points of a pixel, which share its rays", least=1)
    views: int = setting("views of each figure beside the frontal one, turned and in perspective, to train on", least=0)
    seed: int = setting("seed of rays and views", least=0)
    version: int = setting(VERSION, least=0)


@dataclass
class Split:
    """Figures to train on and figures to test on."""

    kind: str = setting(
        "the draw of the test: whole subjects (subject); single figures (paper); every second figure of the test's "
        "subjects, whose other figures are left out (disjoint) or trained on (siblings)",
        choices=("subject", "paper", "disjoint", "siblings"),
    )
    test: float = setting("share of the figures that are tested on", above=0, below=1)
    sitting: str = setting(
        "figures that sit: apart, neither trained nor tested on, or dealt out like the others",
        choices=("apart", "dealt"),
    )
    least: float = setting("share of the figures that must be usable, else the run ends", least=0, most=1)
    seed: int = setting("seed of the draw", least=0)


@dataclass
class Panoramas:
    """What lights are made from."""

    source: str = setting("generated panoramas, or the files of a folder", choices=("generated", "folder"))
    folder: str | None = setting("folder of panoramas, searched with its subfolders", None)
    count: int = setting("number of generated rooms", least=0)
    skies: int = setting("number of generated skies", least=0)
    seed: int = setting("first seed of rooms and of skies", least=0)
    layout: str = setting(
        "layout of the files; auto goes by metadata and aspect ratio",
        choices=("auto", "latlong", "angular", "ball", "cross", "strip", "strip-gl"),
    )
    yaw: float = setting("rotation of every light about the vertical, from +z toward +x, degrees")
    flip: bool = setting("whether left and right are mirrored")
    upside_down: bool = setting("whether the rows of files run from the bottom up", False)
    repair: bool = setting(
        "whether pixels that are not finite get the mean of their neighbours; else the file is left out", False
    )
    version: int = setting(VERSION, least=0)


@dataclass
class Rules:
    """Limits of usual lights, scaled to their reference brightness: a light that breaks one is unusual.

    Irradiance is that of luminance. The front is all normals with z > 0. Rules about the main direction apply to lights
    with |L1| / L00 > 0.35.
    """

    bright: float = setting("largest irradiance of the front", above=0)
    channel: float = setting("largest irradiance of the front in one channel", above=0)
    dim: float = setting("least irradiance at the normal (0, 0, 1)", least=0)
    back: float = setting("largest ratio of the mean irradiance of the back to that of the front", least=0)
    toward: float = setting("least cosine between main direction and direction to the camera", least=-1, most=1)
    contrast: float = setting("least ratio of the front's darkest to its brightest irradiance", most=1)
    first: float = setting("largest |L1| / L00", least=0)
    colour: float = setting("largest |ln R/G| and |ln B/G| of the mean radiance", least=0)
    below: float = setting("least elevation of the main direction, degrees", least=-90, most=90)


@dataclass
class Lights:
    """The light set: how lights of panoramas are scaled, rotated, selected and split."""

    order: str = setting(
        "unusual lights are removed before the clustering (cut_first) or after it (paper)",
        choices=("cut_first", "paper"),
    )
    threshold: float = setting("least reference brightness of a panorama, in its own units; 0 keeps all", least=0)
    low: float = setting("least reference brightness of a light: it is drawn uniformly from [low, high]", above=0)
    high: float = setting("largest reference brightness of a light", above=0)
    rotations: int = setting("headings of each panorama", least=1)
    clusters: int = setting("number of usual lights", least=2)
    test: int = setting("number of usual lights that are tested on, fewer than clusters", least=1)
    extra_test: int = setting("further test lights, of panoramas that give no training light", least=0)
    split: str = setting(
        "split of training and test lights: by panorama (room), or at random", choices=("room", "random")
    )
    veto: str | None = setting("file with a source, or source:heading, per line: lights that are removed", None)
    rules: Rules = field(default_factory=Rules)
    seed: int = setting("seed of scales, clusters and split", least=0)
    version: int = setting(VERSION, least=0)


@dataclass
class Model:
    """The network."""

    name: str = setting("architecture", choices=("ours", "sfsnet", "sfsnet_ao", "unet", *extensions.names()))
    width: float = setting("factor on the number of channels of every layer", least=0.01)
    norm: str = setting("normalisation by the statistics of each image or of the batch", choices=("instance", "batch"))
    dropout: float = setting("share of features that are zeroed in training", least=0, below=1)
    order: int = setting("order of the transport and light that it infers", least=1)
    albedo: str = setting(
        "how albedo is kept in [0, 1]: clipped; clipped, with a gradient outside; or a sigmoid",
        choices=("clip", "straight_through", "sigmoid"),
    )
    light_head: str = setting(
        "how the light is inferred: by strided convolutions, or by pooling over the figure",
        choices=("strided", "pooled"),
    )
    refine: bool = setting("whether the light is refined so that it explains the image by the inferred maps")
    sees: str = setting("input: the image and its mask, or the mask alone", choices=("image", "mask"))


@dataclass
class Loss:
    """Weights of the losses; a loss of weight 0 is not computed."""

    albedo: float = setting("error of albedo", least=0)
    transport: float = setting("error of transport, or of normals and AO where the network infers these", least=0)
    light: float = setting("error of the light", least=0)
    tv_albedo: float = setting("total variation of albedo", least=0)
    tv_transport: float = setting("total variation of transport", least=0)
    shading: float = setting(
        "error of shading: of the inferred transport, of the inferred light, and of both; each of the three", least=0
    )
    reconstruction: float = setting(
        "error of the relit image where one or two of albedo, transport and light are inferred; each of the six",
        least=0,
    )
    reconstruction_full: float = setting("error of the relit image where all three are inferred", least=0)
    detail_albedo: float = setting("energy of the detail of albedo's error over that of the truth's", least=0)
    detail_transport: float = setting("the same of transport", least=0)
    detail_shading: float = setting("the same of shading under the true light", least=0)
    exclusion: float = setting("detail that albedo and shading share beyond what the true ones do", least=0)
    extra: dict[str, float] = setting("losses of your own, by the files of relight/extensions", {})
    tv_reference: int = setting("the weight tv_transport is multiplied by image size / tv_reference, pixels", least=1)
    reduction: str = setting("means over the whole image or over its mask", choices=("image", "mask"))


@dataclass
class Train:
    """One training."""

    steps: int = setting("number of steps", least=1)
    batch: int = setting("pairs of figure and light per step", least=1)
    lr: float = setting("learning rate of Adam", above=0)
    beta1: float = setting("decay of Adam's mean of gradients", least=0, below=1)
    beta2: float = setting("decay of Adam's mean of squared gradients", least=0, below=1)
    schedule: str = setting("schedule of the learning rate after the warm-up", choices=("constant", "cosine"))
    warmup: int = setting("steps in which the learning rate rises to lr", least=0)
    color: str = setting(
        "colour model: albedo as the paper takes it, or linear, with pictures as a camera stores them",
        choices=("paper", "photo"),
    )
    seed: int = setting("seed of weights, pairs and augmentation", least=0)
    device: str = setting("where it is trained; auto takes a GPU where there is one", choices=DEVICES)
    precision: str = setting("precision of matrix products: 32 bits, or bfloat16", choices=("f32", "bf16"))
    epoch: int = setting("steps between two lines of the log, with metrics and a checkpoint", least=1)
    pairs: str = setting(
        "figures and lights are paired at random (shuffled), or a figure's lights follow each other as in the authors' "
        "code (rows)",
        choices=("shuffled", "rows"),
    )
    optimizer: str = setting("Adam, or Adam with decoupled weight decay", choices=("adam", "adamw"))
    decay: float = setting("weight decay of adamw", least=0)
    average: float = setting(
        "decay of the moving average of the weights, which is what is kept; 0 keeps the last weights", least=0, below=1
    )
    mirror: bool = setting("whether half of the pairs are mirrored left to right")
    compile: bool = setting("whether torch.compile compiles the network, which pays on a GPU")
    start: str | None = setting("network of the same kind to start from: a file, or a run of the sweep", None)
    only: str | None = setting("part of `start` that is trained; null trains all of it", None, choices=("encoder",))
    part: str = setting(
        "figures of the split to train on; the test's only with losses that use no truth",
        "train",
        choices=("train", "test"),
    )
    size: int | None = setting(
        "side of the images, pixels, at most that of the maps, which null stands for", None, least=64, multiple=64
    )
    figures: int | None = setting(
        "number of figures, drawn by the seed; fewer are a part of more; null takes all", None, least=1
    )
    lights: list[str] = setting(
        "splits of the light set to train under; the test's only with losses that use no truth",
        ["train"],
        choices=("train", "rich", "test"),
    )
    version: int = setting(VERSION, least=0)


@dataclass
class Augment:
    """What photographers, cameras and masks do to pictures, drawn anew for each training pair; 0 turns a part off.

    Pixels are those of the network's image. Framing, tint, exposure and recolouring change picture and truth alike, all
    else the picture alone.
    """

    framing: float = setting("share of the pictures that are framed anew", least=0, most=1)
    cut: float = setting("share of those that end between chest and knees", least=0, most=1)
    zoom: list[float] = setting("size of the figure, as a factor on the usual framing", interval=True, above=0)
    shift: float = setting("largest shift of the figure's box from the centre, as a share of the side", least=0)
    tint: float = setting("standard deviation of ln(B/G) of the white balance", least=0)
    exposure: list[float] = setting("exposure, stops", interval=True)
    recolour: float = setting("share of the pictures in which garments get other colours", least=0, most=1)
    prints: float = setting(
        "share of the pictures in which garments get stripes, checks, dots or blots", least=0, most=1
    )
    gloss: float = setting("share of the pictures in which some materials are glossy", least=0, most=1)
    mask: int = setting("largest error of the mask's outline, pixels", least=0)
    tone: float = setting("strength of the tone curve and of changes of saturation", least=0)
    blur: float = setting("largest standard deviation of the blur, pixels", least=0)
    sharpen: float = setting("largest weight of the unsharp mask", least=0)
    noise: float = setting("largest standard deviation of the noise, as a share of white, of coded values", least=0)
    jpeg: float = setting("share of the pictures that are compressed, at qualities from 40 to 95", least=0, most=1)


# The parts of Augment that change pictures, beside `exposure`.
STRENGTHS = ("framing", "tint", "recolour", "prints", "gloss", "mask", "tone", "blur", "sharpen", "noise", "jpeg")
NO_AUGMENTATION = Augment(**dict.fromkeys((*STRENGTHS, "cut", "shift"), 0), zoom=[1.0, 1.0], exposure=[0.0, 0.0])


@dataclass
class Evaluate:
    """Scores of networks, and the tables and pictures of them."""

    lights: str = setting("lights of the set to score under; an experiment sets it", choices=SCORED_LIGHTS)
    device: str = setting("where networks infer", choices=DEVICES)
    version: int = setting(VERSION, least=0)
    bootstrap: int = setting("resamples of the figures for each interval and p-value", 2000, least=1)
    plates: int = setting("test figures on a plate", 4, least=1)
    sheet: int = setting("figures on the contact sheet", 48, least=1)
    seed: int = setting("seed of the resamples and of the figures that are shown", 0, least=0)
    figures: str = setting("part of the split that is scored; an experiment sets it", "test", choices=PARTS)


@dataclass
class Trace:
    """Path tracing of test figures, for the experiment `path_traced`."""

    figures: int = setting("test figures that are traced, spread over the test", least=1)
    samples: int = setting("paths per pixel", least=2)
    bounces: int = setting("bounces of interreflection: of albedo .5, a hundredth of it is missing after 6", least=0)
    seed: int = setting("seed of the paths", least=0)
    version: int = setting(VERSION, least=0)


@dataclass
class Timing:
    """Seconds for a picture, for the experiment `inference_time`."""

    sizes: list[int] = setting("sides of the images, pixels", above=0, multiple=64)
    seconds: float = setting("time spent on each measurement at least", above=0)
    version: int = setting(VERSION, least=0)


@dataclass
class Experiment:
    """A question: some runs of the sweep, what they are scored on, and a section of the report."""

    rows: list[str] = setting("runs that the section compares, in order")
    title: str = setting("title of its section and table; the experiment's name where it is empty", "")
    question: str = setting("the question, in a sentence", "")
    figures: str = setting("part of the split that its rows are scored on", "test", choices=PARTS)
    lights: str = setting("lights of the set that they are scored under", "test", choices=SCORED_LIGHTS)
    axis: str | None = setting("setting, such as model.width, against which errors are plotted", None)
    table: bool = setting("whether its rows are trained and scored; else it has stages of its own", True)
    plates: bool = setting("whether its rows are shown side by side on test figures", False)


@dataclass
class Sweep:
    """What is trained: the presets of `experiment` add runs."""

    runs: dict[str, list[str]] = setting("the settings of each run, as overrides, by its name")
    only: list[str] | None = setting("names of the runs that are trained; null trains all", None)
    seeds: list[int] = setting("each run is trained once with each of them", least=0)


@dataclass
class Track:
    """The record in MLflow."""

    uri: str | None = setting("where runs are recorded: sqlite:///FILE or a server's address; null records none", None)
    experiment: str = setting("MLflow's name for what the runs belong to", "relight")


@dataclass
class Config:
    """All settings."""

    name: str = setting("name of the folder in results/")
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


def fields_by_key(schema: type, above: str = "") -> Iterator[tuple[str, Field[Any]]]:
    """Yields the settings of a schema, such as `train.lr`, and their fields; groups within groups, too."""
    for item in fields(schema):
        if isinstance(item.type, type) and is_dataclass(item.type):
            yield from fields_by_key(item.type, f"{above}{item.name}.")
        elif "setting" in item.metadata:
            yield f"{above}{item.name}", item


FIELDS = dict(fields_by_key(Config))
EXPERIMENT = dict(fields_by_key(Experiment))  # of each experiment


def field_of(key: str) -> Field[Any] | None:
    """Returns the field of a setting, such as `train.lr` or `experiments.table1.rows`; None where there is none."""
    group, _, rest = key.partition(".")
    return EXPERIMENT.get(rest.partition(".")[2]) if group == "experiments" else FIELDS.get(key)
