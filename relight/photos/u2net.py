"""Masks by rembg's network of people (U2-Net), or by another ONNX network of its kind.

rembg fetches its model once, when the user says so; it is run here, without rembg's own start of half a minute.
"""

import os
from pathlib import Path

import numpy as np
from PIL import Image

from relight.files import UserError, existing_file

MODEL = "u2net_human_seg"
SIDE = 320  # pixels that it sees
MEAN, DEVIATION = np.array([0.485, 0.456, 0.406], np.float32), np.array([0.229, 0.224, 0.225], np.float32)  # ImageNet's


def coverage(pixels: np.ndarray, model: Path) -> np.ndarray:
    """Coverage (H,W) uint8 of the people in `pixels` (H,W,3) uint8 sRGB by the ONNX network `model`.

    Raises UserError when the model or onnxruntime is missing, and for a model of another kind.
    """
    model = existing_file(model, "--mask-model")
    try:
        import onnxruntime
    except ImportError:
        raise UserError(f"{model.name} needs onnxruntime: pip install 'relight[mask]'") from None
    image = np.asarray(Image.fromarray(pixels).resize((SIDE, SIDE), Image.Resampling.LANCZOS), np.float32)
    image = (image / max(float(image.max()), 1.0) - MEAN) / DEVIATION
    try:
        session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
        inputs = {session.get_inputs()[0].name: np.moveaxis(image, -1, 0)[None].astype(np.float32)}
        found = np.asarray(session.run(None, inputs)[0], np.float32).reshape(SIDE, SIDE)
    except Exception as error:  # onnxruntime's and numpy's errors about a model that is not of this kind
        reason = str(error).splitlines()[0]
        raise UserError(f"{model} does not work as a segmentation model of rembg's kind ({reason})") from None
    found = (found - found.min()) / max(float(np.ptp(found)), 1e-6)
    size = pixels.shape[1::-1]
    return np.asarray(Image.fromarray(np.round(found * 255).astype(np.uint8)).resize(size, Image.Resampling.BICUBIC))


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
