"""Predictors that look at no picture: what a table's numbers are worth shows beside them (method, section 7).

| name            | infers                                                         | is given                     |
|-----------------|----------------------------------------------------------------|------------------------------|
| `mean_figure`   | each map as its mean over the training figures, and `mean_light` | the mask                   |
| `mean_light`    | the mean training light                                        | true maps                    |
| `nearest_light` | the training light nearest to the true one (an oracle's choice) | true maps, the true light   |
| `no_occlusion`  | transport of the true normals: the most that SfSNet can reach   | true normals, albedo, light |
| `ao_occlusion`  | the same times the true AO: the most that SfSNet-AO can reach   | and the true AO             |
| `as_it_is`      | pictures that are not relit: the one in the old light           | the picture                 |
| `cut_2`, ...    | the true transport without bands over 2: the most of order 2    | true maps, the true light    |
"""

from pathlib import Path

import numpy as np

from relight import config
from relight.evaluation.evaluate import Predictor, has_pairs, pixels, rows, score, torch_device, truth
from relight.evaluation.metrics import Inferred
from relight.evaluation.scores import write_scores
from relight.files import UserError
from relight.learning.data import RelitSet, read_split
from relight.sh import order_of, unoccluded


def evaluate_baselines(
    packed: Path,
    lights: Path,
    split: Path,
    settings: config.Evaluate,
    out: Path,
    color: str = "paper",
    order: int = 2,
) -> None:
    """Writes the scores (CSV) of all baselines, on the same pairs as `evaluate`.

    color is that of the networks to be compared with (train.color); order the data's own (bake.order).
    """
    data = RelitSet(packed, lights, order, color, torch_device("cpu"))
    if not has_pairs(data, split, settings):
        return write_scores(out, {})
    predictors = make(data, split)
    write_scores(out, {name: score(predictor, data, split, settings) for name, predictor in predictors.items()})


def make(data: RelitSet, split: Path) -> dict[str, Predictor]:
    """The predictors in the table above, from the training figures of `split` and the lights marked `train`."""
    figures = data.figures(read_split(split)["train"])
    train_lights = data.lights.numpy()[data.light_split == "train"]
    if not len(figures) or not len(train_lights):
        raise UserError(f"baselines: {len(figures)} training figures and {len(train_lights)} training lights are found")
    mean_light = train_lights.mean(0, keepdims=True)
    order = order_of(mean_light.shape[1])
    mean = MeanFigure(data, figures)

    def true(name: str, figure: int) -> np.ndarray:
        return getattr(data, name)[rows(data, figure)].float().numpy()[None]

    def mean_figure(figure: int, lit: np.ndarray) -> Inferred:
        maps = mean.at(pixels(data, figure))
        light = np.repeat(mean_light, len(lit), 0)
        return Inferred(maps["albedo"], maps["transport"], maps["normal"], maps["ao"], light)

    def nearest_light(figure: int, lit: np.ndarray) -> Inferred:
        distances = ((data.lights.numpy()[lit][:, None] - train_lights[None]) ** 2).sum((2, 3))
        return Inferred(light=train_lights[distances.argmin(1)])

    def no_occlusion(figure: int, lit: np.ndarray) -> Inferred:
        return Inferred(transport=unoccluded(true("normal", figure), order).astype(np.float32))

    def ao_occlusion(figure: int, lit: np.ndarray) -> Inferred:
        return Inferred(transport=no_occlusion(figure, lit).transport * true("ao", figure)[..., None])

    def as_it_is(figure: int, lit: np.ndarray) -> Inferred:
        return Inferred(relit=truth(data, figure, lit).maps["reconstruction"])

    def cut(bands: int) -> Predictor:
        return lambda figure, lit: Inferred(transport=true("transport", figure)[..., : (bands + 1) ** 2])

    return {
        "mean_figure": mean_figure,
        "mean_light": lambda figure, lit: Inferred(light=np.repeat(mean_light, len(lit), 0)),
        "nearest_light": nearest_light,
        "no_occlusion": no_occlusion,
        "ao_occlusion": ao_occlusion,
        "as_it_is": as_it_is,
        **{f"cut_{bands}": cut(bands) for bands in range(2, order)},
    }


class MeanFigure:
    """The mean of the training figures at each pixel; where none of them reaches, the mean over all their pixels."""

    def __init__(self, data: RelitSet, figures: np.ndarray):
        every = np.r_[tuple(rows(data, figure) for figure in figures)]
        place = data.pixel.numpy()[every]
        count = np.bincount(place, minlength=data.size**2)
        self.maps = {}
        for name in ("albedo", "transport", "normal", "ao"):
            values = getattr(data, name).numpy()[every].astype(np.float64).reshape(len(every), -1)
            if name == "albedo" and data.color == "paper":
                values = values / 255
            total = np.stack([np.bincount(place, column, data.size**2) for column in values.T], 1)
            self.maps[name] = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], values.mean(0))

    def at(self, pixel: np.ndarray) -> dict[str, np.ndarray]:
        """The maps (1,P,C) and ao (1,P) at flat pixel indices (P,), float32; normals are renormalised."""
        maps = {name: values[pixel].astype(np.float32)[None] for name, values in self.maps.items()}
        maps["normal"] /= np.linalg.norm(maps["normal"], axis=-1, keepdims=True)
        return {**maps, "ao": maps["ao"][..., 0]}
