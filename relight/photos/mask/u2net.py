"""Masks by rembg's network for people (U2-Net), or by another ONNX network of its kind.

rembg downloads its model when a user asks it to. It runs here without rembg itself, whose start takes half a minute.
"""

import os
from pathlib import Path

import numpy as np
from PIL import Image

from relight.core.errors import UserError
from relight.core.files import existing_file
from relight.photos.network import open_session

MODEL = "u2net_human_seg"
SIDE = 320  # pixels of its input
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)  # ImageNet's


def segment(pixels: np.ndarray, model: Path) -> np.ndarray:
    """Segments the people of a photo.

    Args:
        pixels: (H,W,3) uint8 sRGB.
        model: an ONNX file.

    Returns:
        Coverage (H,W) uint8.

    Raises:
        UserError: if there is no such file, or the model is of another kind.
    """
    model = existing_file(model, "--mask-model")
    image = np.asarray(Image.fromarray(pixels).resize((SIDE, SIDE), Image.Resampling.LANCZOS), np.float32)
    image = (image / max(float(image.max()), 1.0) - MEAN) / DEVIATION
    try:
        session = open_session(model)
        inputs = {session.get_inputs()[0].name: np.moveaxis(image, -1, 0)[None].astype(np.float32)}
        mask = np.asarray(session.run(None, inputs)[0], np.float32).reshape(SIDE, SIDE)
    except Exception as error:  # of onnxruntime or NumPy, for a model of another kind
        reason = str(error).splitlines()[0]
        raise UserError(f"{model} does not work as a segmentation model of rembg's kind ({reason})") from None
    mask = (mask - mask.min()) / max(float(np.ptp(mask)), 1e-6)
    codes = Image.fromarray(np.round(mask * 255).astype(np.uint8))
    return np.asarray(codes.resize(pixels.shape[1::-1], Image.Resampling.BICUBIC))


def fetched_model() -> Path | None:
    """Finds the model that rembg has downloaded, where its current or older versions keep it; None if there is none."""
    homes = [os.environ.get(name) for name in ("U2NET_HOME", "REMBG_HOME")] + ["~/.rembg", "~/.u2net"]
    if data := os.environ.get("XDG_DATA_HOME"):
        homes += [f"{data}/rembg", f"{data}/.u2net"]
    for home in filter(None, homes):
        for path in (f"models/{MODEL}/{MODEL}.onnx", f"{MODEL}.onnx"):
            if (found := Path(home).expanduser() / path).is_file():
                return found
    return None
