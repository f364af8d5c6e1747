"""Compares relit pictures with path tracing (the paper, section 7.2 and supplement), and splits the error by cause.

A chain of pictures leads from a network's relit picture to a path tracing of the same mesh in the whole panorama. Each
picture differs from the next by one cause, whose name is on its line:

    network          albedo^ * max(T^.L, 0), inferred maps relit
    clipping         albedo * max(T.L, 0), true maps relit: the reference of the other scores
    sampling         albedo * T.L, which may be negative, since L has few coefficients
    baker            the same with more samples of the pixel's area than the maps have (bake.supersample)
    truncation       path traced in the panorama cut to the order of T and L
    interreflection  path traced in the whole panorama, without interreflection
    (the end)        path traced with interreflection

Squared errors are mean products of the differences of two independent renderings, which noise does not bias.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from relight.core.errors import UserError
from relight.core.files import atomic_write
from relight.core.progress import progress
from relight.evaluation.experiments.tracing import Scene, read_scenes
from relight.evaluation.pictures.panels import PLATE_FIGURES, Cell, Line, Subject, draw, evenly_spaced
from relight.evaluation.scoring.evaluate import infer, load, truth
from relight.evaluation.scoring.labels import label
from relight.evaluation.scoring.metrics import shade
from relight.evaluation.scoring.truth import Inferred, Truth
from relight.learning.data import RelitSet
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
MAX_ERROR = 0.3  # error of a picture (vector norm) at the dark end of the color scale


@dataclass
class Chain:
    """The chain of pictures of one scene: (P,3), or (2,P,3) if traced.

    Attributes:
        scene: the traced figure.
        truth: the figure under the light of the input picture.
        albedo: (P,3), true.
        pictures: those of ANSWERS, by name.
    """

    scene: Scene
    truth: Truth
    albedo: np.ndarray
    pictures: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, data: RelitSet, scene: Scene) -> "Chain":
        """Returns the chain of a scene. Raises UserError if it was traced with other maps or at another order."""
        if scene.figure >= len(data.names) or scene.seen >= len(data.light_split):
            raise UserError("the path traced scenes belong to a larger data set than this: trace them again")
        true = truth(data, scene.figure, np.array([scene.seen]))
        albedo, transport = true.maps["albedo"][0], true.transport[0]
        if len(albedo) != len(scene.area) or transport.shape[1] != len(scene.light):
            raise UserError(f"{data.names[scene.figure]} was traced with other maps than these: trace it again")
        normal, ao, light = true.maps["normal"][0], true.maps["ao"][0], scene.light
        open_sky = unoccluded(normal, order_of(len(light)))
        pictures = {
            "truth": albedo * shade(transport, light),
            "ao_occlusion": albedo * shade(open_sky * ao, light),
            "no_occlusion": albedo * shade(open_sky, light),
            "as_it_is": true.maps["reconstruction"][0],
        }
        return cls(scene, true, albedo, pictures)

    def steps(self) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Yields (cause, picture before it, picture after it) for each of CAUSES except the network."""
        scene, transport = self.scene, self.truth.transport[0]
        irradiances = (transport @ scene.light, scene.area, scene.cut, scene.direct, scene.full)
        pictures = [self.pictures["truth"], *(self.albedo * values for values in irradiances)]
        yield from zip(list(CAUSES)[1:], pictures, pictures[1:])

    def relight(self, inferred: Inferred) -> np.ndarray:
        """Returns the picture (P,3) of inferred maps under the new light; albedo that is not inferred is true."""
        albedo, transport, _ = self.truth.complete(inferred)
        return (albedo * shade(transport, self.scene.light))[0]

    @property
    def full(self) -> np.ndarray:
        """The end of the chain, from two independent renderings (2,P,3)."""
        return self.albedo * self.scene.full

    def measure_difference(self, before: np.ndarray, after: np.ndarray) -> list[float]:
        """Returns COLUMNS of the difference of two pictures, without bias from the noise of traced ones.

        They are the RMSE of the vector norm, the same over the root mean square of the traced picture, and the mean of
        the difference over the mean of the traced picture.
        """
        first, second = np.broadcast_to(before - after, self.full.shape)
        rmse = np.sqrt(max((first * second).sum(-1).mean(), 0))
        norm = np.sqrt((self.full[0] * self.full[1]).sum(-1).mean())
        return [rmse, rmse / norm, (before - after).mean() / self.full.mean()]


def evaluate_traced(networks: dict[str, Path], packed: Path, lights: Path, traced: Path, out: Path) -> None:
    """Measures relit pictures against path tracing.

    The chain of a scene leads from true maps, relit, to the path-traced picture; each step adds one effect.

    Args:
        networks: `row.s<seed>` -> checkpoint.
        packed, lights: the data set.
        traced: file of `tracing.trace`.
        out: the table (.csv) of KEYS and COLUMNS. Rows of kind `answer` compare a picture of ANSWERS or of a network
            with the end of the chain. Rows of kind `cause` are steps of the chain; that of a network is named
            `network:row.s<seed>`.
    """
    rows: list[list] = []
    scenes_done: set[int] = set()
    for name, checkpoint in progress(list(networks.items()), "networks against path tracing"):
        network, data = load(checkpoint, packed, lights)
        for place, scene in enumerate(read_scenes(traced)):
            chain, key = Chain.of(data, scene), [data.names[scene.figure], scene.new]
            relit = chain.relight(infer(network, data, scene.figure, np.array([scene.seen])))
            pairs = [("answer", name, relit, chain.full), ("cause", f"network:{name}", relit, chain.pictures["truth"])]
            if place not in scenes_done:
                scenes_done.add(place)
                pairs += [("answer", answer, chain.pictures[answer], chain.full) for answer in ANSWERS]
                pairs += [("cause", *step) for step in chain.steps()]
            rows += [[kind, row, *key, *chain.measure_difference(before, after)] for kind, row, before, after in pairs]
    table = pd.DataFrame(rows, columns=[*KEYS, *COLUMNS])
    with atomic_write(out) as tmp:
        table.to_csv(tmp, index=False, float_format="%.6g", lineterminator="\n")


def traced_plate(networks: dict[str, Path], packed: Path, lights: Path, traced: Path, out: Path) -> None:
    """Draws traced figures: the input, relit by each network and by the true maps, path traced, and the errors.

    The last column is the light that interreflection adds.

    Args:
        networks: row -> checkpoint.
        packed, lights, traced: as in `evaluate_traced`.
        out: the picture (.png).
    """
    chains: list[Chain] = []
    subjects: list[Subject] = []
    relit: list[list[np.ndarray]] = []
    for checkpoint in networks.values():
        network, data = load(checkpoint, packed, lights)
        if not chains:
            scenes = read_scenes(traced)
            chains = [Chain.of(data, scenes[i]) for i in evenly_spaced(len(scenes), PLATE_FIGURES)]
            subjects = [Subject.of(data, c.scene.figure, np.array([c.scene.seen])) for c in chains]
            relit = [[] for _ in chains]
        for chain, pictures in zip(chains, relit):
            pictures.append(chain.relight(infer(network, data, chain.scene.figure, np.array([chain.scene.seen]))))
    cells = map(_views, chains, relit)
    lines = [Line(subject.name, subject, of_subject) for subject, of_subject in zip(subjects, cells)]
    heads = ["input", *(f"relit by {label(row)}" for row in networks), "true maps, relit", "path traced"]
    heads += [*(f"error of {label(row)}" for row in networks), "error of the true maps", "inter-reflection"]
    note = (
        "Relit by the panorama of a test light; the sphere in the corner is lit by its coefficients, which networks "
        "and maps are given. Errors are relative to the path traced picture and include its noise."
    )
    draw(heads, lines, MAX_ERROR, note).save(out)


def _views(chain: Chain, relit: list[np.ndarray]) -> list[Cell]:
    """Returns a row of `traced_plate`; `relit` are the pictures (P,3) by each network."""
    traced, true, light = chain.full.mean(0), chain.pictures["truth"], chain.scene.light
    direct = chain.albedo * chain.scene.direct.mean(0)
    return [
        Cell(chain.pictures["as_it_is"], light=chain.truth.lights[0]),
        *(Cell(picture, light=light) for picture in [*relit, true, traced]),
        *(Cell(error=np.linalg.norm(picture - traced, axis=-1)) for picture in [*relit, true, direct]),
    ]
