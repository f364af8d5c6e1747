"""Errors of inferred maps and lights, as the paper's section 6.1 takes them, in every reading that its text allows.

RMSE of maps is taken inside the mask, SSIM inside the tight bounding box of the mask with everything outside the mask
zeroed in both pictures. The root mean square is over pixels of the **vector** norm (the reading that the paper's
printed numbers agree with) and, in a second column, over elements. SSIM is scikit-image's (uniform window, sample
covariance, mean over channels) with an explicit data range and, in a second column, with the range of 2 that old
releases of scikit-image assumed of every float image.
"""

from dataclasses import dataclass

import numpy as np
from skimage.metrics import structural_similarity

from relight.lights.show import open_ball
from relight.sh import order_of

WINDOW = 7  # scikit-image's default
OLD_RANGE = 2.0  # what scikit-image < 0.16 took for float images
SPHERE = 64  # pixels across the sphere that shows a light

# The span of the values that each quantity can take, rounded to whole numbers.
RANGE = {
    "shading": 1.0,
    "shading_true_light": 1.0,
    "transport": 2.0,
    "transport_with_ao": 2.0,
    "normal": 2.0,
    "ao": 1.0,
    "albedo": 1.0,
    "reconstruction": 1.0,
    "relit": 1.0,
    "sphere": 1.0,
    "light": 2.0,
}
READINGS = ("rmse", "rmse_element", "ssim", "ssim_range2")
COLUMNS = tuple(f"{quantity}_{reading}" for quantity in RANGE for reading in READINGS)
# What tells whether shading and albedo have changed places: of no table, but in the scores.
COLLAPSE = ("shading_contrast", "albedo_share")
COMMON = 9  # coefficients in which maps and lights are compared, whatever their order


@dataclass
class Inferred:
    """What a network or a baseline infers of the P in-mask pixels of one figure under N lights; None: it is given that.

    A leading 1 stands for "the same under every light".

    Attributes:
        albedo: (N,P,3).
        transport: (N,P,K).
        normal: (N,P,3), of unit length.
        ao: (N,P).
        light: (N,K,3).
        relit: (N,P,3), whole pictures under the light after their own, of what infers no maps; only they are scored.
        occlude: whether the shading is ao * (transport @ light), as SfSNet-AO has it; else ao is scored alone.
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
        """The transport of the shading: times AO where that occludes."""
        if self.transport is None or self.ao is None or not self.occlude:
            return self.transport
        return self.transport * self.ao[..., None]


def rmse(inferred: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Root of the mean over pixels of the squared vector norm: (...,P,C), (...,P,C) -> (...)."""
    difference = inferred - truth
    return np.sqrt(np.einsum("...pc,...pc->...", difference, difference) / difference.shape[-2])


def ssim(inferred: np.ndarray, truth: np.ndarray, span: float, window: int = WINDOW) -> np.ndarray:
    """Mean structural similarity (Wang et al. 2004) by scikit-image, over windows and channels.

    Args:
        inferred: (N,H,W,C); H and W at least `window`.
        truth: (N,H,W,C), or (1,H,W,C) for all.
        span: the range that the values can take.
        window: side of the uniform window in pixels.

    Returns:
        (N,).
    """
    truth = np.broadcast_to(truth, (len(inferred), *truth.shape[1:]))
    pairs = zip(inferred.astype(np.float64), truth.astype(np.float64))
    return np.array([structural_similarity(*two, win_size=window, channel_axis=-1, data_range=span) for two in pairs])


class Truth:
    """One figure under N lights, ready to be compared with many predictions.

    Shadings are clipped at 0: light of few bands may dip below it. They are made with all K coefficients, while
    transport and light are compared in the first nine: networks of any order stand in one table.

    Args:
        pixel: (P,) flat indices of the mask into a `size` x `size` image.
        transport: (P,K).
        albedo: (P,3).
        normal: (P,3).
        ao: (P,).
        lights: (N,K,3).
        size: pixels.

    Attributes:
        maps: (1,P,C) by name, and (N,P,3) of shading and reconstruction; the transport in the first nine coefficients.
        transport: (1,P,K).
        lights: (N,K,3).
    """

    def __init__(self, pixel, transport, albedo, normal, ao, lights, size: int):
        self.maps = {"transport": transport, "albedo": albedo, "normal": normal, "ao": ao[:, None]}
        self.maps = {name: np.asarray(array, np.float32)[None] for name, array in self.maps.items()}
        self.transport, self.lights = self.maps["transport"], np.asarray(lights, np.float32)
        self.maps["transport"] = self.transport[..., :COMMON]
        self.maps["shading"] = shade(self.transport, self.lights)
        self.maps["reconstruction"] = self.maps["albedo"] * self.maps["shading"]
        self._box(np.asarray(pixel), size)

    def _box(self, pixel: np.ndarray, size: int) -> None:
        row, column = np.divmod(pixel, size)
        top, height = _at_least(row.min(), row.max() + 1)
        left, width = _at_least(column.min(), column.max() + 1)
        self.shape = height, width
        self.inside = (row - top) * width + column - left

    def boxed(self, values: np.ndarray) -> np.ndarray:
        """(N,P,C) -> (N,h,w,C): the tight bounding box of the mask (at least one window), zero outside the mask."""
        box = np.zeros((len(values), self.shape[0] * self.shape[1], values.shape[-1]), np.float64)
        box[:, self.inside] = values
        return box.reshape(len(values), *self.shape, -1)

    def compare(self, name: str, values: np.ndarray, quantity: str | None = None) -> dict[str, np.ndarray]:
        """The four readings of `values` (N or 1,P,C) against the true map `name`, each (N,) or (1,)."""
        truth, quantity = self.maps[name], quantity or name
        values = np.broadcast_to(values, (max(len(values), len(truth)), *values.shape[1:]))
        pictures = self.boxed(values), self.boxed(truth)
        return _readings(quantity, rmse(values, truth), values.shape[-1], pictures)

    def compare_relit(self, pictures: np.ndarray) -> dict[str, np.ndarray]:
        """The readings `relit`, each (N,), of pictures (N,P,3) that were inferred under light n and relit by light
        n + 1, the first one following the last; none under a single light."""
        if len(self.lights) == 1:
            return {}
        found = self.compare("reconstruction", np.roll(pictures, 1, 0), "relit")
        return {name: np.roll(values, -1) for name, values in found.items()}

    def complete(self, inferred: Inferred) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Albedo (N or 1,P,3), transport (N or 1,P,K) and light (N,K,3), true where they are not inferred."""
        albedo = self.maps["albedo"] if inferred.albedo is None else inferred.albedo
        transport = self.transport if (occluded := inferred.occluded_transport) is None else occluded
        return albedo, transport, self.lights if inferred.light is None else inferred.light

    def score(self, inferred: Inferred) -> dict[str, np.ndarray]:
        """Scores a prediction.

        Args:
            inferred: under the lights of the truth.

        Returns:
            COLLAPSE, and those of COLUMNS that it infers something of, each (N,) float64. Shading and reconstruction
            are made with the truth for what it does not infer.
        """
        if inferred.relit is not None:
            return self.compare_relit(inferred.relit)
        columns: dict[str, np.ndarray] = {}
        for name in ("transport", "albedo", "normal"):
            if (values := getattr(inferred, name)) is not None:
                columns |= self.compare(name, values[..., :COMMON])
        if inferred.ao is not None:
            columns |= self.compare("ao", inferred.ao[..., None])
        albedo, transport, light = self.complete(inferred)
        if inferred.occlude:
            columns |= self.compare("transport", transport[..., :COMMON], "transport_with_ao")
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
        columns["albedo_share"] = explained(self.maps["reconstruction"], albedo)
        return {name: np.broadcast_to(values, len(self.lights)) for name, values in columns.items()}


def shade(transport: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Shading (N,P,3) of transport (N or 1,P,K) under light (N or 1,K,3), clipped at 0; the fewer bands count."""
    common = min(transport.shape[-1], light.shape[-2])
    return np.maximum(np.matmul(transport[..., :common], light[..., :common, :]), 0)


def contrast(shading: np.ndarray) -> np.ndarray:
    """Standard deviation over mean of the grey shading over pixels: (N,P,3) -> (N,); 0 for a bleached one."""
    grey = shading.mean(-1, dtype=np.float64)
    return grey.std(-1) / np.maximum(grey.mean(-1), 1e-9)


def explained(picture: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Share of the picture's variation over pixels that albedo alone explains: (N,P,3), (N or 1,P,3) -> (N,).

    One factor per colour channel stands for the light, chosen best: 1 is an albedo that is the picture, and 0 one that
    says no more than a uniform colour.
    """
    albedo = np.broadcast_to(albedo, picture.shape).astype(np.float64)
    factor = (picture * albedo).sum(1) / np.maximum((albedo**2).sum(1), 1e-12)
    left = ((picture - factor[:, None] * albedo) ** 2).sum((1, 2))
    return 1 - left / np.maximum(((picture - picture.mean(1, keepdims=True)) ** 2).sum((1, 2)), 1e-12)


def light_errors(inferred: np.ndarray, truth: np.ndarray) -> dict[str, np.ndarray]:
    """Errors of light (N or 1,K,3): of the first nine raw coefficients (RMSE per element, SSIM with a window of 3), and
    of the sphere that it lights. Both RMSE columns of the raw light are per element: 9 x 3 numbers have no pixels to
    take norms at.
    """
    inferred = np.broadcast_to(inferred, (len(truth), *inferred.shape[1:])).astype(np.float64)
    first, second = inferred[:, :COMMON], truth[:, :COMMON]
    element = np.sqrt(np.mean((first - second) ** 2, (1, 2)))
    columns = _readings("light", element, 1, (first[..., None], second[..., None]), window=3)

    disc, transport = open_ball(SPHERE, order_of(truth.shape[1]))
    spheres = [shade(transport, light.astype(np.float64)) for light in (inferred, truth)]
    pictures = np.zeros((2, len(truth), *disc.shape, 3))
    pictures[:, :, disc] = spheres
    return columns | _readings("sphere", rmse(*spheres), 3, (pictures[0], pictures[1]))


def _readings(
    quantity: str, error: np.ndarray, channels: int, pictures: tuple[np.ndarray, np.ndarray], window: int = WINDOW
) -> dict[str, np.ndarray]:
    """READINGS of a quantity from its RMSE (N,) and its pictures, inferred and true (N or 1,H,W,C)."""
    spans = (RANGE[quantity], OLD_RANGE)
    similarity = {span: ssim(*pictures, span=span, window=window) for span in set(spans)}  # once where they are equal
    names = (f"{quantity}_{reading}" for reading in READINGS)
    return dict(zip(names, (error, error / np.sqrt(channels), *(similarity[span] for span in spans))))


def _at_least(start: int, stop: int) -> tuple[int, int]:
    """Start and length of a side of the bounding box, widened to one window where a mask is thinner than that."""
    missing = max(0, WINDOW - (stop - start))
    return start - missing // 2, stop - start + missing
