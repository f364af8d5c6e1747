"""Relit pictures against path tracing (paper, section 7.2 and its supplement), their difference told by its causes.

Between what a network relights and a path tracing of the same mesh in the whole panorama stands a chain of pictures.
Each differs from the next by one cause, which has its name:

    network          albedo^ * max(T^.L, 0), what the network infers, relit
    clipping         albedo * max(T.L, 0), the true maps relit: what a network is scored against elsewhere
    sampling         albedo * T.L: a light of few coefficients may bring it below 0
    baker            the same as the mean over the pixel's area: maps hold what is at its centre
    truncation       path traced in the panorama cut to the order of T and L
    interreflection  path traced in the whole panorama, with light from the sky alone
    (the end)        path traced with interreflection

The mean product of the differences of two independent renderings is free of the noise that one square would hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from relight import config
from relight.evaluation.evaluate import infer, load, truth
from relight.evaluation.formats import Grid
from relight.evaluation.labels import label
from relight.evaluation.metrics import Inferred, Truth, shade
from relight.evaluation.panels import Line, Subject, View, draw, spaced
from relight.evaluation.scores import read_table
from relight.evaluation.statistics import estimate
from relight.evaluation.tracing import Scene, read_scenes
from relight.files import UserError, atomic_write
from relight.learning.data import RelitSet
from relight.progress import progress
from relight.run_name import RunName
from relight.sh import order_of, unoccluded

CAUSES = {
    "network": "what the network infers",
    "clipping": "shading below 0 cut off",
    "sampling": "the maps' samples in place of the pixel's area",
    "baker": "transport: baked, not traced",
    "truncation": "light cut to the order of the transport",
    "interreflection": "no light from surface to surface",
}
ANSWERS = {
    "truth": "true maps",
    "ao_occlusion": "true normals and AO",
    "no_occlusion": "true normals without occlusion",
    "as_it_is": "the picture as it is",
}
KEYS = ("kind", "name", "figure", "light")
COLUMNS = ("rmse", "relative", "bias")
WORST = 0.3  # error of a picture (vector norm) at the dark end of the scale


@dataclass
class Chain:
    """The pictures of one scene, (P,3), or (2,P,3) where they are traced.

    Attributes:
        scene: the figure relit.
        truth: the figure under the light in which the networks are shown it.
        albedo: (P,3), true.
        own: pictures of ANSWERS, by name.
    """

    scene: Scene
    truth: Truth
    albedo: np.ndarray
    own: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, data: RelitSet, scene: Scene) -> "Chain":
        """The chain without networks. UserError when the scene was traced with other maps or at another order."""
        true = truth(data, scene.figure, np.array([scene.seen]))
        albedo, transport = true.maps["albedo"][0], true.transport[0]
        if len(albedo) != len(scene.area) or transport.shape[1] != len(scene.light):
            raise UserError(f"{data.names[scene.figure]} was traced with other maps than these: trace it again")
        normal, ao, light = true.maps["normal"][0], true.maps["ao"][0], scene.light
        open_sky = unoccluded(normal, order_of(len(light)))
        own = {
            "truth": albedo * shade(transport, light),
            "ao_occlusion": albedo * shade(open_sky * ao, light),
            "no_occlusion": albedo * shade(open_sky, light),
            "as_it_is": true.maps["reconstruction"][0],
        }
        return cls(scene, true, albedo, own)

    def steps(self) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Cause, picture before it and after it, for all causes but the network."""
        s, transport = self.scene, self.truth.transport[0]
        pictures = [self.own["truth"]]
        pictures += [self.albedo * values for values in (transport @ s.light, s.area, s.cut, s.direct, s.full)]
        yield from zip(list(CAUSES)[1:], pictures, pictures[1:])

    def relight(self, inferred: Inferred) -> np.ndarray:
        """The picture (P,3) of what was inferred under one light, under the new one; albedo is true where none was."""
        albedo, transport, _ = self.truth.complete(inferred)
        return (albedo * shade(transport, self.scene.light))[0]

    @property
    def full(self) -> np.ndarray:
        """The end of the chain, made twice (2,P,3)."""
        return self.albedo * self.scene.full

    def measured(self, before: np.ndarray, after: np.ndarray) -> list[float]:
        """Measures the difference of two pictures; traced noise cancels out but for chance.

        Args:
            before, after: (P,3) or (2,P,3).

        Returns:
            COLUMNS: the RMSE of the vector norm, the same over the root mean square of the traced picture, and the mean
            of the difference over the mean of the traced picture.
        """
        first, second = np.broadcast_to(before - after, self.full.shape)
        rmse = np.sqrt(max((first * second).sum(-1).mean(), 0))
        level = np.sqrt((self.full[0] * self.full[1]).sum(-1).mean())
        return [rmse, rmse / level, (before - after).mean() / self.full.mean()]


def evaluate_traced(
    networks: dict[str, Path], packed: Path, lights: Path, traced: Path, settings: config.Evaluate, out: Path
) -> None:
    """Measures relit pictures against path tracing.

    Args:
        networks: `row.s<seed>` -> checkpoint.
        packed, lights: the data set.
        traced: what `tracing.trace` wrote.
        settings: `device`.
        out: the table (.csv) of KEYS and COLUMNS. A row of kind `answer` is a whole picture against the path tracing
            with interreflection, of ANSWERS or of a network; one of kind `cause` a step of the chain, the network's
            being `network:row.s<seed>`.
    """
    rows: list[list] = []
    known: set[int] = set()
    for name, checkpoint in progress(list(networks.items()), "networks against path tracing"):
        network, data = load(checkpoint, packed, lights, settings)
        for place, scene in enumerate(read_scenes(traced)):
            chain, key = Chain.of(data, scene), [data.names[scene.figure], scene.new]
            relit = chain.relight(infer(network, data, scene.figure, np.array([scene.seen])))
            made = [("answer", name, relit, chain.full), ("cause", f"network:{name}", relit, chain.own["truth"])]
            if place not in known:
                known.add(place)
                made += [("answer", answer, chain.own[answer], chain.full) for answer in ANSWERS]
                made += [("cause", *step) for step in chain.steps()]
            rows += [[kind, row, *key, *chain.measured(before, after)] for kind, row, before, after in made]
    table = pd.DataFrame(rows, columns=[*KEYS, *COLUMNS])
    with atomic_write(out) as tmp:
        table.to_csv(tmp, index=False, float_format="%.6g", lineterminator="\n")


def tables(path: Path, settings: config.Evaluate) -> dict[str, Grid]:
    """Estimates the answers and the causes of a file of `evaluate_traced`; the trainings of a row are averaged.

    Args:
        path: the file (.csv).
        settings: how many resamples, and their seed.

    Returns:
        The tables `path_traced_causes` and `path_traced`.

    Raises:
        UserError: the file is no such table.
    """
    found = read_table(path, "errors against path tracing", [*KEYS, *COLUMNS], "relight-path-traced")
    found["row"] = [RunName.parse(name).run for name in found["name"]]
    figures, values = found["figure"].nunique(), dict(list(found.groupby(["kind", "row"], sort=False)))
    networks = {row: label(row) for kind, row in values if kind == "answer" and row not in ANSWERS}
    causes = {f"network:{row}": f"{CAUSES['network']}: {words}" for row, words in networks.items()}
    causes |= {name: words for name, words in CAUSES.items() if name != "network"}

    def grid(kind: str, labels: dict[str, str]) -> Grid:
        """A row per name, in the order of `labels`."""
        rows, kinds = [], []
        for name in labels:
            if (kind, name) in values:
                numbers = values[kind, name][list(COLUMNS)].to_numpy().reshape(-1, figures, len(COLUMNS))
                each = np.moveaxis(numbers * [1, 100, 100], -1, 0)[..., None]
                rows.append([labels[name], *(estimate(one, settings.bootstrap, settings.seed) for one in each)])
                kinds.append("baseline" if name in ANSWERS else "network")
        heads, digits = ["", "RMSE", "relative, %", "mean, %"], {"RMSE": 4, "relative, %": 1, "mean, %": 1}
        return Grid.of(heads, rows, kinds, digits)

    return {"path_traced_causes": grid("cause", causes), "path_traced": grid("answer", {**networks, **ANSWERS})}


def traced_plate(
    networks: dict[str, Path], packed: Path, lights: Path, traced: Path, settings: config.Evaluate, out: Path
) -> None:
    """Draws traced figures: the input, relit by each network and by the true maps, and path traced.

    The errors of these against the traced picture follow, and what interreflection adds to it.

    Args:
        networks: row -> checkpoint.
        packed, lights: the data set.
        traced: what `tracing.trace` wrote.
        settings: `plates`, at most so many figures.
        out: the picture (.png).
    """
    chains: list[Chain] = []
    subjects: list[Subject] = []
    relit: list[list[np.ndarray]] = []
    for checkpoint in networks.values():
        network, data = load(checkpoint, packed, lights, settings)
        if not chains:
            scenes = read_scenes(traced)
            chains = [Chain.of(data, scenes[i]) for i in spaced(len(scenes), settings.plates)]
            subjects = [Subject.of(data, c.scene.figure, np.array([c.scene.seen])) for c in chains]
            relit = [[] for _ in chains]
        for chain, pictures in zip(chains, relit):
            pictures.append(chain.relight(infer(network, data, chain.scene.figure, np.array([chain.scene.seen]))))
    lines = [Line(s.name, s, views(chain, pictures)) for s, chain, pictures in zip(subjects, chains, relit)]
    heads = ["input", *(f"relit by {label(row)}" for row in networks), "true maps, relit", "path traced"]
    heads += [*(f"error of {label(row)}" for row in networks), "error of the true maps", "inter-reflection"]
    words = (
        "Relit by the panorama of a test light, whose sphere stands in the corner as networks and maps know it, by its "
        "coefficients. Errors are against the path traced picture and hold its noise."
    )
    draw(heads, lines, WORST, words).save(out)


def views(chain: Chain, relit: list[np.ndarray]) -> list[View]:
    """A row of the plate."""
    goal, true, light = chain.full.mean(0), chain.own["truth"], chain.scene.light
    direct = chain.albedo * chain.scene.direct.mean(0)
    return [
        View(chain.own["as_it_is"], light=chain.truth.lights[0]),
        *(View(picture, light=light) for picture in [*relit, true, goal]),
        *(View(error=np.linalg.norm(picture - goal, axis=-1)) for picture in [*relit, true, direct]),
    ]
