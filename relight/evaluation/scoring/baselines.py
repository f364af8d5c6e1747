"""Predicts without a network, as baselines for the scores (docs/lab/method.md, section 7).

| name            | predicts                                                       | is given                     |
|-----------------|----------------------------------------------------------------|------------------------------|
| `mean_figure`   | each map as its mean over the training figures, and `mean_light` | the mask                   |
| `mean_light`    | the mean training light                                        | true maps                    |
| `nearest_light` | the training light nearest to the true one                      | true maps, the true light   |
| `no_occlusion`  | transport of the true normals, at which SfSNet aims             | true normals, albedo, light |
| `mean_occlusion` | the same times the mean AO of the training figures             | true normals, albedo, light |
| `ao_occlusion`  | the same times the true AO, at which SfSNet-AO aims             | and the true AO             |
| `as_it_is`      | the input picture in place of the relit one                     | the picture                 |
"""

from pathlib import Path

import numpy as np
import torch

from relight.core.errors import UserError
from relight.evaluation.scoring.evaluate import Predictor, pixel_rows, pixels, truth, write_all_scores
from relight.evaluation.scoring.truth import Inferred
from relight.learning.data import RelitSet, read_split
from relight.sh import order_of, unoccluded


def evaluate_baselines(
    packed: Path, lights: Path, split: Path, condition: str, out: Path, color: str = "paper", order: int = 2
) -> None:
    """Writes the scores of all baselines.

    Args:
        packed, lights, split: the data set (.safetensors, .npz, .json).
        condition: the figures and lights, as `select_pairs` takes them.
        out: the scores (.csv).
        color: color model of the networks to be compared with (`train.color`).
        order: order of the data (`bake.order`).
    """
    torch.set_num_threads(1)
    data = RelitSet(packed, lights, order, color)
    write_all_scores(make_predictors(data, split), data, split, condition, out)


def make_predictors(data: RelitSet, split: Path) -> dict[str, Predictor]:
    """Returns the predictors of the module's table by name. Raises UserError without training figures or lights."""
    figures = data.figures(read_split(split)["train"])
    train_lights = data.lights.numpy()[data.light_split == "train"]
    if not len(figures) or not len(train_lights):
        raise UserError(
            f"baselines: {len(figures)} training figures and {len(train_lights)} training lights are found; at least "
            "one of each is needed"
        )
    order = order_of(train_lights.shape[1])
    mean = _mean_figure(data, figures)
    mean_ao = np.concatenate([data.ao[pixel_rows(data, figure)].float().numpy() for figure in figures]).mean()

    def true(name: str, figure: int) -> np.ndarray:
        """Returns a true map (1,P,C) of a figure at its P pixels; (1,P) for AO."""
        return getattr(data, name)[pixel_rows(data, figure)].float().numpy()[None]

    def mean_figure(figure: int, lights: np.ndarray) -> Inferred:
        maps = {name: values[pixels(data, figure)].astype(np.float32)[None] for name, values in mean.items()}
        maps["normal"] /= np.linalg.norm(maps["normal"], axis=-1, keepdims=True)
        light = mean_light(figure, lights).light
        return Inferred(maps["albedo"], maps["transport"], maps["normal"], maps["ao"][..., 0], light)

    def mean_light(figure: int, lights: np.ndarray) -> Inferred:
        return Inferred(light=np.repeat(train_lights.mean(0, keepdims=True), len(lights), 0))

    def nearest_light(figure: int, lights: np.ndarray) -> Inferred:
        true_lights = data.lights.numpy()[lights]
        distances = ((true_lights[:, None] - train_lights[None]) ** 2).sum((2, 3))  # (N, training lights)
        return Inferred(light=train_lights[distances.argmin(1)])

    def no_occlusion(figure: int, lights: np.ndarray) -> Inferred:
        return Inferred(transport=unoccluded(true("normal", figure), order).astype(np.float32))

    def mean_occlusion(figure: int, lights: np.ndarray) -> Inferred:
        return Inferred(transport=no_occlusion(figure, lights).transport * mean_ao)

    def ao_occlusion(figure: int, lights: np.ndarray) -> Inferred:
        return Inferred(transport=no_occlusion(figure, lights).transport * true("ao", figure)[..., None])

    def as_it_is(figure: int, lights: np.ndarray) -> Inferred:
        return Inferred(relit=truth(data, figure, lights).maps["reconstruction"])

    predictors = mean_figure, mean_light, nearest_light, no_occlusion, mean_occlusion, ao_occlusion, as_it_is
    return {predictor.__name__: predictor for predictor in predictors}


def _mean_figure(data: RelitSet, figures: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the mean maps (S*S,C) of figures with these indices (F,), of an image of side S.

    At pixels outside all figures, it is the mean over all pixels.
    """
    rows = np.r_[tuple(pixel_rows(data, figure) for figure in figures)]  # of all pixels of these figures
    pixel = data.pixel.numpy()[rows]  # where each lies in its image
    count = np.bincount(pixel, minlength=data.size**2)[:, None]
    maps = {}
    for name in ("albedo", "transport", "normal", "ao"):
        values = getattr(data, name).numpy()[rows].astype(np.float64).reshape(len(rows), -1)
        if name == "albedo" and data.color == "paper":  # stored as 8-bit codes
            values = values / 255
        total = np.stack([np.bincount(pixel, channel, data.size**2) for channel in values.T], 1)
        maps[name] = np.where(count > 0, total / np.maximum(count, 1), values.mean(0))
    return maps
