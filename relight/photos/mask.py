"""Where the figures are: the mask of a photo, and one coverage map per person in it."""

import os
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt, label

from relight.files import UserError
from relight.photos.frame import SOLID
from relight.photos.read import Photo, read_mask

MODEL = "u2net_human_seg"
SIDE = 320  # pixels that it sees
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)
LEAST = 8  # pixels: a figure smaller than this in both directions is dirt


def mask_of(photo: Photo, path: Path | str | None = None, model: Path | str | None = None) -> np.ndarray:
    """Coverage (H,W) uint8 of a photo: the mask file, else the photo's alpha, else an automatic mask.

    model: an ONNX segmentation model of rembg's kind, for the automatic mask. Raises UserError.
    """
    if path is not None:
        mask = read_mask(path, photo.pixels.shape[:2])
        if (mask >= SOLID).all():
            raise UserError(f"mask {path} covers the whole photo: it must be white on the person and black elsewhere")
        if not (mask >= SOLID).any():
            raise UserError(f"mask {path} is empty: no pixel of it is at least half white")
        return mask
    if photo.alpha is not None:
        if not (photo.alpha >= SOLID).any():
            raise UserError(f"photo {photo.name} has an alpha channel without any opaque pixel: nobody to relight")
        return photo.alpha
    return automatic(photo, model)


def automatic(photo: Photo, model: Path | str | None = None) -> np.ndarray:
    """Coverage by a segmentation network of rembg's kind (U2-Net: 320 x 320, ImageNet's mean and deviation).

    rembg fetches its model once, when the user says so; it is run here, without rembg's own start of half a minute.
    Nothing is downloaded. Raises UserError when the model or onnxruntime is missing.
    """
    help_ = "give --mask FILE (white on the person) or a PNG with an alpha channel"
    path = Path(model) if model else fetched_model()
    if path is None or not path.is_file():
        raise UserError(
            f"photo {photo.name} has no mask: {help_}; or for automatic masks run once: "
            f"pip install 'relight[mask]' && rembg d {MODEL}"
        )
    try:
        import onnxruntime
    except ImportError:
        raise UserError(f"automatic masks need onnxruntime: pip install 'relight[mask]', or {help_}") from None
    image = np.asarray(Image.fromarray(photo.pixels).resize((SIDE, SIDE), Image.Resampling.LANCZOS), np.float32)
    image = (image / max(float(image.max()), 1.0) - MEAN) / DEVIATION
    try:
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        inputs = {session.get_inputs()[0].name: np.moveaxis(image, -1, 0)[None].astype(np.float32)}
        found = np.asarray(session.run(None, inputs)[0], np.float32).reshape(SIDE, SIDE)
    except Exception as error:  # onnxruntime's and numpy's errors about a model that is not of this kind
        reason = str(error).splitlines()[0]
        raise UserError(f"{path} does not work as a segmentation model of rembg's kind ({reason})") from None
    found = (found - found.min()) / max(float(np.ptp(found)), 1e-6)
    size = photo.pixels.shape[1::-1]
    mask = np.asarray(Image.fromarray(np.round(found * 255).astype(np.uint8)).resize(size, Image.Resampling.BICUBIC))
    if not (mask >= SOLID).any() or (mask >= SOLID).all():
        raise UserError(f"the automatic mask found nobody in {photo.name}: {help_}")
    return mask


def fetched_model() -> Path | None:
    """Where rembg keeps its model of people, now or in its older versions; None when it was not fetched."""
    homes = [os.environ.get(name) for name in ("U2NET_HOME", "REMBG_HOME")] + ["~/.rembg", "~/.u2net"]
    if data := os.environ.get("XDG_DATA_HOME"):
        homes += [f"{data}/rembg", f"{data}/.u2net"]
    for home in filter(None, homes):
        for path in (f"models/{MODEL}/{MODEL}.onnx", f"{MODEL}.onnx"):
            if (found := Path(home).expanduser() / path).is_file():
                return found
    return None


def people(coverage: np.ndarray, share: float = 0.05) -> list[np.ndarray]:
    """Splits coverage (H,W) uint8 into one such map per person, from left to right.

    A person is a connected solid part with at least `share` of the largest one's area; smaller parts (a hand
    behind a lamp post, a buckle) and soft edges go to the nearest person, so the parts' sum is the whole.
    """
    solid = coverage >= SOLID
    labels, count = label(solid, np.ones((3, 3)))
    areas = np.bincount(labels.ravel(), minlength=count + 1)
    areas[0] = 0
    whom = [i for i in np.flatnonzero(areas >= share * areas.max()) if i and _large_enough(labels == i)]
    if not whom:
        raise UserError(f"the mask holds no figure of at least {LEAST} pixels")
    if len(whom) == 1:
        return [coverage]
    nearest = distance_transform_edt(~np.isin(labels, whom), return_distances=False, return_indices=True)
    owner = labels[tuple(nearest)]
    whom.sort(key=lambda i: np.flatnonzero((labels == i).any(0)).mean())
    return [np.where(owner == i, coverage, np.uint8(0)) for i in whom]


def _large_enough(mask: np.ndarray) -> bool:
    return max(mask.any(1).sum(), mask.any(0).sum()) >= LEAST
