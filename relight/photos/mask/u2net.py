"""Masks by an ONNX network for segmentation that the user names, such as rembg's for people (U2-Net)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.photos.network import open_session

SIDE = 320  # pixels of an input that leaves them open
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])  # ImageNet's
USUAL = "imagenet"
# What a network takes for RGB codes of 0 to 255, by its name.
NORMALISATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    USUAL: lambda codes: (codes / max(float(codes.max()), 1.0) - MEAN) / DEVIATION,  # as rembg does
    "rgb": lambda codes: codes / 255,
    "bgr": lambda codes: codes[..., ::-1] / 255,
    "signed": lambda codes: codes / 127.5 - 1,
}


def named_model(text: Path | str) -> tuple[Path, str]:
    """Splits the name of a network, such as david.onnx:bgr, into its file and one of NORMALISATIONS.

    Raises:
        UserError: if it is none of them.
    """
    file, colon, word = str(text).rpartition(":")
    if not colon or Path(text).is_file():
        return Path(text), USUAL
    if word not in NORMALISATIONS:
        raise UserError(f"--mask-model {text}: {word!r} is none of {', '.join(NORMALISATIONS)}, which a network takes")
    return Path(file), word


def segment(pixels: np.ndarray, model: Path | str) -> np.ndarray:
    """Segments the people of a photo, which is squeezed to the size of the network's input.

    Args:
        pixels: (H,W,3) uint8 sRGB.
        model: an ONNX file with one input, channels first or last, and the mask as its first output: in [0,1], or else
            before a sigmoid; of several classes, people are the last. The name is split by `named_model`.

    Returns:
        Coverage (H,W) uint8.

    Raises:
        UserError: if there is no such file, or the model is of another kind.
    """
    path, word = named_model(model)
    existing_file(path, "--mask-model")
    try:
        session = open_session(path)
        (entry,) = session.get_inputs()
        _, *sides = entry.shape if entry.shape[-1] == 3 else [entry.shape[i] for i in (0, 2, 3, 1)]
        size = [side if isinstance(side, int) else SIDE for side in sides[1::-1]]
        image = np.asarray(Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS), np.float32)
        image = NORMALISATIONS[word](image).astype(np.float16 if "float16" in entry.type else np.float32)
        inputs = {entry.name: (image if entry.shape[-1] == 3 else np.moveaxis(image, -1, 0))[None]}
        mask = np.squeeze(np.asarray(session.run(None, inputs)[0], np.float32))
        if mask.ndim == 3:
            mask = np.moveaxis(mask, np.argmin(mask.shape), 0)[-1]
        if mask.ndim != 2 or not np.isfinite(mask).all():
            raise ValueError(f"its output is of shape {mask.shape}, or not finite")
    except Exception as error:  # of onnxruntime or NumPy, for a model of another kind
        raise UserError(f"{path} does not work as a network for segmentation ({str(error).splitlines()[0]})") from None
    if mask.min() < -0.01 or mask.max() > 1.01:
        mask = 1 / (1 + np.exp(-mask.clip(-50, 50)))
    if word == USUAL:
        mask = (mask - mask.min()) / max(float(np.ptp(mask)), 1e-6)
    codes = Image.fromarray(np.round(mask.clip(0, 1) * 255).astype(np.uint8))
    return np.asarray(codes.resize(pixels.shape[1::-1], Image.Resampling.BICUBIC))
