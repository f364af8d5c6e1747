"""Scores predictions against the truth by the errors of the paper's section 7.1, in each reading that its text allows.

The RMSE of maps is computed inside the mask, over pixels of the **vector** norm (with which the paper's printed numbers
agree) and, in a second column, over elements. SSIM has an explicit data range and, in a second column, the range of 2
that old releases of scikit-image assumed for float images.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relight.core.errors import UserError
from relight.evaluation.scoring.metrics import WINDOW, MaskBox, contrast, explained_variance, rmse, ssim
from relight.lights.show import unoccluded_ball
from relight.photos.shading import shade
from relight.settings.scores import COLUMNS, QUANTITIES, READINGS
from relight.sh import order_of

OLD_RANGE = 2.0  # data range that scikit-image < 0.16 assumed for float images
SPHERE = 64  # pixels, diameter of the sphere that shows a light

COMMON_COEFFICIENTS = 9  # number of coefficients in which transport and lights of any order are compared


def in_order(columns: Iterable[str]) -> list[str]:
    """Returns columns of scores in the order of COLUMNS. Raises UserError about one that is not there."""
    given = set(columns)
    if unknown := sorted(given - set(COLUMNS)):
        raise UserError(f"scores: {unknown[0]} must be one of QUANTITIES and one of READINGS (relight.settings.scores)")
    return [column for column in COLUMNS if column in given]


@dataclass
class Inferred:
    """The prediction of a network or a baseline for the P in-mask pixels of a figure under N lights.

    What is None is replaced by the truth. A leading dimension of 1 means the same under all lights.

    Attributes:
        albedo: (N,P,3).
        transport: (N,P,K).
        normal: (N,P,3), of unit length.
        ao: (N,P).
        light: (N,K,3).
        relit: (N,P,3), pictures under the next light, of methods without maps; if given, only these are scored.
        occlude: whether the shading is ao * (transport @ light), as for SfSNet-AO; otherwise `ao` has no effect on it.
    """

    albedo: np.ndarray | None = None
    transport: np.ndarray | None = None
    normal: np.ndarray | None = None
    ao: np.ndarray | None = None
    light: np.ndarray | None = None
    relit: np.ndarray | None = None
    occlude: bool = False

    @property
    def occluded_transport(self) -> np.ndarray | None:
        """The transport of the shading: multiplied by AO if `occlude`."""
        if self.transport is None or self.ao is None or not self.occlude:
            return self.transport
        return self.transport * self.ao[..., None]


class Truth:
    """The ground truth of a figure under N lights, to compare predictions with.

    Shading has all K coefficients, and is clipped at 0, below which lights of few bands can be. Transport and light are
    compared in the first nine coefficients, so that networks of any order can be compared.

    Attributes:
        maps: by name, (1,P,C), and (N,P,3) for shading and reconstruction; transport has nine coefficients.
        transport: (1,P,K).
        lights: (N,K,3).
    """

    def __init__(self, pixel: ArrayLike, maps: Mapping[str, ArrayLike], lights: ArrayLike, size: int):
        """Takes the maps `transport` (P,K), `albedo` and `normal` (P,3), `ao` (P,1), and lights (N,K,3), of any type.

        `pixel` (P,) are flat indices of the mask into a `size` x `size` image.
        """
        self.maps = {name: np.asarray(array, np.float32)[None] for name, array in maps.items()}
        self.transport, self.lights = self.maps["transport"], np.asarray(lights, np.float32)
        self.maps["transport"] = self.transport[..., :COMMON_COEFFICIENTS]
        self.maps["shading"] = shade(self.transport, self.lights)
        self.maps["reconstruction"] = self.maps["albedo"] * self.maps["shading"]
        self.box = MaskBox(np.asarray(pixel), size)

    def compare(self, name: str, values: np.ndarray, quantity: str | None = None) -> dict[str, np.ndarray]:
        """Compares values with a true map in the first four of READINGS.

        Args:
            name: of the map, a key of `maps`.
            values: (N or 1,P,C).
            quantity: that the columns name; by default that of the map.

        Returns:
            Column, such as albedo_rmse -> (N,), or (1,) if neither the values nor the map depend on the light.
        """
        truth, quantity = self.maps[name], quantity or name
        values = np.broadcast_to(values, (max(len(values), len(truth)), *values.shape[1:]))
        pictures = self.box.crop(values), self.box.crop(truth)
        return _readings(quantity, rmse(values, truth), values.shape[-1], pictures)

    def compare_relit(self, pictures: np.ndarray) -> dict[str, np.ndarray]:
        """Returns the readings (N,) of relit pictures, by column; empty for a single light.

        Args:
            pictures: (N,P,3), inferred under light n and relit by light n + 1 (cyclic).
        """
        if len(self.lights) == 1:
            return {}
        readings = self.compare("reconstruction", np.roll(pictures, 1, 0), "relit")
        return {name: np.roll(values, -1) for name, values in readings.items()}

    def complete(self, inferred: Inferred) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns albedo (N or 1,P,3), transport (N or 1,P,K) and light (N,K,3), true where they are not inferred."""
        albedo = self.maps["albedo"] if inferred.albedo is None else inferred.albedo
        transport = self.transport if (occluded := inferred.occluded_transport) is None else occluded
        return albedo, transport, self.lights if inferred.light is None else inferred.light

    def score(self, inferred: Inferred) -> dict[str, np.ndarray]:
        """Scores a prediction.

        Args:
            inferred: under the lights of the truth.

        Returns:
            Column -> (N,) float64, for those of COLUMNS for which something is inferred. Shading and reconstruction are
            computed with the truth for what is not inferred.
        """
        if inferred.relit is not None:
            return self.compare_relit(inferred.relit)
        columns: dict[str, np.ndarray] = {}
        for name in ("transport", "albedo", "normal"):
            if (values := getattr(inferred, name)) is not None:
                columns |= self.compare(name, values[..., :COMMON_COEFFICIENTS])
        if inferred.ao is not None:
            columns |= self.compare("ao", inferred.ao[..., None])
        albedo, transport, light = self.complete(inferred)
        if inferred.occlude:
            columns |= self.compare("transport", transport[..., :COMMON_COEFFICIENTS], "transport_with_ao")
        shading = shade(transport, light)
        columns |= self.compare("shading", shading)
        if inferred.transport is not None:
            columns |= self.compare("shading", shade(transport, self.lights), "shading_true_light")
        columns |= self.compare("reconstruction", albedo * shading)
        if inferred.transport is not None:
            columns |= self.compare_relit(albedo * shade(transport, np.roll(self.lights, -1, 0)))
        if inferred.light is not None:
            columns |= light_errors(inferred.light, self.lights)
        columns["shading_contrast"] = contrast(shading) / np.maximum(contrast(self.maps["shading"]), 1e-9)
        columns["albedo_share"] = explained_variance(self.maps["reconstruction"], albedo)
        return {name: np.broadcast_to(values, len(self.lights)) for name, values in columns.items()}


def light_errors(inferred: np.ndarray, truth: np.ndarray) -> dict[str, np.ndarray]:
    """Returns errors of lights (N or 1,K,3) by column: of the first nine coefficients, and of a sphere that they light.

    For the coefficients, both RMSE columns are per element, and SSIM has a window of 3.
    """
    inferred = np.broadcast_to(inferred, (len(truth), *inferred.shape[1:])).astype(np.float64)
    first, second = inferred[:, :COMMON_COEFFICIENTS], truth[:, :COMMON_COEFFICIENTS]
    element = np.sqrt(np.mean((first - second) ** 2, (1, 2)))
    as_pictures = first[..., None], second[..., None]  # (N,9,3,1)
    columns = _readings("light", element, channels=1, pictures=as_pictures, window=3)

    disc, transport = unoccluded_ball(SPHERE, order_of(truth.shape[1]))
    spheres = [shade(transport, light.astype(np.float64)) for light in (inferred, truth)]
    pictures = np.zeros((2, len(truth), *disc.shape, 3))
    pictures[:, :, disc] = spheres
    return columns | _readings("sphere", rmse(*spheres), channels=3, pictures=(pictures[0], pictures[1]))


def _readings(
    quantity: str, error: np.ndarray, channels: int, pictures: tuple[np.ndarray, np.ndarray], window: int = WINDOW
) -> dict[str, np.ndarray]:
    """Returns the first four READINGS of a quantity by column, (N,) each.

    `error` (N,) is the RMSE of the vector norm; over elements, it is smaller by the root of `channels`. `pictures` are
    the inferred and the true ones, (N,H,W,C).
    """
    spans = (QUANTITIES[quantity].span, OLD_RANGE)
    similarity = {span: ssim(*pictures, span=span, window=window) for span in set(spans)}  # once if both are equal
    readings = (error, error / np.sqrt(channels), *(similarity[span] for span in spans))
    return {f"{quantity}_{name}": values for name, values in zip(READINGS, readings)}
