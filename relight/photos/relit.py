"""A relit picture as notebooks show it: the photo before, and after."""

import base64
import io

import numpy as np
from PIL import Image

SHOWN = 480  # pixels of the longer side in a notebook


class Relit(np.ndarray):
    """The relit picture, an array (H,W,3) or (H,W,4) uint8 sRGB; what is computed from it is a plain one.

    before: the photo (H,W,3) uint8.
    """

    before: np.ndarray

    @classmethod
    def of(cls, pixels: np.ndarray, before: np.ndarray) -> "Relit":
        """The pixels (no copy), with the photo that they come from."""
        relit = pixels.view(cls)
        relit.before = before
        return relit

    def __array_finalize__(self, source: np.ndarray | None) -> None:
        self.before = None

    def __array_wrap__(self, array: np.ndarray, *_) -> np.ndarray:
        return array

    def _repr_html_(self) -> str | None:
        """Both pictures side by side, in the page itself; None for a part of a picture, which is shown as numbers."""
        if self.before is None:
            return None
        return "".join(
            f'<figure style="display:inline-block;margin:0 8px 0 0"><img alt="{name}" src="data:image/webp;base64,'
            f'{_webp(pixels)}"><figcaption>{name}</figcaption></figure>'
            for name, pixels in (("before", self.before), ("after", self))
        )


def _webp(pixels: np.ndarray) -> str:
    image = Image.fromarray(np.asarray(pixels))
    image.thumbnail((SHOWN, SHOWN), Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "WEBP", quality=90)
    return base64.b64encode(file.getvalue()).decode()
