"""The nodes: mask of people, lights, the relit picture, and albedo, shading and normals.

As in all of ComfyUI, IMAGE is a float tensor (B,H,W,3) of sRGB codes in [0,1], and MASK (B,H,W) in [0,1]; here 1 is a
person. RELIGHT_LIGHT is a `relight.lights.Light`. torch is ComfyUI's own; relight computes with NumPy and ONNX Runtime.
"""

import hashlib
import tempfile
from collections import OrderedDict
from functools import cache
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from relight.photos.api import Relighter, load

MEMORY = 16  # keys of inferences that are kept, two for each; an inference takes CPU-seconds
CATEGORY = "relight"
DISPLAY_STRENGTH = 0.5  # shading may exceed 1: half of it is shown


class RememberingRelighter(Relighter):
    """A relighter that infers a picture with the same mask once, so that turning a light is quick.

    Attributes:
        memory: the people of a picture by a key of its pixels, options and mask; the oldest first.
    """

    def __init__(self, network):
        super().__init__(network)
        self.memory = OrderedDict()

    def infer(self, image, mask=None, split=True, white_balance="keep"):
        """Infers the people of a picture, or returns those of an earlier call with the same arguments.

        Args:
            image: (H,W,3) uint8 or uint16 sRGB, or a loaded photo, which has its own mask.
            mask: (H,W) uint8 for a picture that is an array; None to find the people.
            split: whether people who do not touch are inferred one by one.
            white_balance: `keep` (the light is white on average) or `scene` (as inferred).
        """
        pixels = image if isinstance(image, np.ndarray) else image.pixels
        options = pixels.shape, hashlib.sha256(pixels.tobytes()).digest(), split, white_balance
        coverage = mask if isinstance(image, np.ndarray) else image.coverage
        key = *options, None if coverage is None else np.asarray(coverage).tobytes()
        people = self.memory.get(key) or super().infer(image, mask, split, white_balance)
        for same in (key, (*options, coverage_of_all(people).tobytes())):  # with the mask that was found, or as given
            self.memory[same] = people
            self.memory.move_to_end(same)
        while len(self.memory) > MEMORY:
            self.memory.popitem(last=False)
        return people


def coverage_of_all(people):
    """Returns the coverage (H,W) uint8 of a picture by its people, a list from `Relighter.infer`."""
    return np.max([person.coverage for person in people], 0)


@cache
def relighter():
    """Returns the relighter of the weights that come with relight; reads them at the first call."""
    return RememberingRelighter(load().network)


def pictures(image):
    """Returns the pictures (H,W,3) uint16 of an IMAGE; 16 bits keep what ComfyUI's floats hold beyond 8."""
    return np.round(image[..., :3].cpu().numpy().clip(0, 1) * 65535).astype(np.uint16)


def coverages(mask, count):
    """Returns the coverage (H,W) uint8, or None, of each of `count` pictures.

    Args:
        mask: MASK with one mask for each picture, or one for all; or None.
        count: number of pictures.

    Raises:
        ValueError: for another number of masks.
    """
    if mask is None:
        return [None] * count
    masks = np.round(255 * mask.reshape(-1, *mask.shape[-2:]).cpu().numpy().clip(0, 1)).astype(np.uint8)
    if len(masks) not in (1, count):
        raise ValueError(f"there are {len(masks)} masks for {count} pictures: give one, or one for each")
    return list(masks) if len(masks) == count else [masks[0]] * count


def to_image(arrays):
    """Returns an IMAGE of arrays (H,W,3), or a MASK of arrays (H,W), of one shape; uint8 and uint16 become [0,1]."""
    scale = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}.get(arrays[0].dtype, 1)
    return torch.from_numpy(np.stack([np.asarray(array, np.float32) / np.float32(scale) for array in arrays]))


class FindMask:
    """Finds the people of pictures, by the network of `relight mask setup`."""

    CATEGORY, FUNCTION = CATEGORY, "run"
    RETURN_TYPES, RETURN_NAMES = ("MASK",), ("mask",)
    DESCRIPTION = "White on the people of a picture. Needs `relight mask setup`, once, in ComfyUI's environment."

    @classmethod
    def INPUT_TYPES(cls):
        """Returns the inputs and widgets of the node, in the form that ComfyUI asks for."""
        return {"required": {"image": ("IMAGE",)}}

    def run(self, image):
        """Returns the MASK (B,H,W) of an IMAGE (B,H,W,3), 1 on people."""
        return (to_image([coverage_of_all(relighter().infer(picture)) for picture in pictures(image)]),)


class NamedLight:
    """A light by name: generated, a lamp, a panorama's file, or coefficients."""

    CATEGORY, FUNCTION = CATEGORY, "run"
    RETURN_TYPES, RETURN_NAMES = ("RELIGHT_LIGHT",), ("light",)
    DESCRIPTION = "room:7, sky:3, lamps:5, key:#ffd9a0@70,20,0.15 (color, degrees right and up, fill), or a file."

    @classmethod
    def INPUT_TYPES(cls):
        """Returns the inputs and widgets of the node, in the form that ComfyUI asks for."""
        return {"required": {"light": ("STRING", {"default": "room:7"})}}

    @classmethod
    def IS_CHANGED(cls, light):
        """Returns a value that differs when the light does: for a file, its name and its time of change."""
        path = Path(light)
        return (light, path.stat().st_mtime_ns) if path.is_file() else light

    def run(self, light):
        """Returns the light that a text names."""
        return (relighter().read_light(light),)


class PanoramaLight:
    """The light of a lat-long panorama that is an IMAGE; the middle of the picture is in front of the camera."""

    CATEGORY, FUNCTION = CATEGORY, "run"
    RETURN_TYPES, RETURN_NAMES = ("RELIGHT_LIGHT",), ("light",)
    DESCRIPTION = "Light of a lat-long panorama. Choose linear if it comes from a loader of EXR or HDR files."

    @classmethod
    def INPUT_TYPES(cls):
        """Returns the inputs and widgets of the node, in the form that ComfyUI asks for."""
        return {"required": {"panorama": ("IMAGE",), "encoding": (["sRGB", "linear"],)}}

    def run(self, panorama, encoding):
        """Returns the light of the first picture of an IMAGE (B,H,W,3); negative values count as 0."""
        from relight import srgb
        from relight.lights import Light
        from relight.panoramas import Panorama, project

        values = panorama[0, ..., :3].cpu().numpy().astype(np.float32)
        if values.shape[1] != 2 * values.shape[0]:
            raise ValueError(f"the panorama is {values.shape[1]} x {values.shape[0]}: give one twice as wide as high")
        pixels = srgb.decode(values.clip(0, 1)).astype(np.float32) if encoding == "sRGB" else values.clip(0)
        panorama = Panorama(pixels, source="panorama of ComfyUI")
        coefficients = project(panorama, relighter().order).astype(np.float32)
        return (Light(coefficients, panorama.source, panorama),)


class Relight:
    """Relights the people of pictures."""

    CATEGORY, FUNCTION = CATEGORY, "run"
    RETURN_TYPES, RETURN_NAMES = ("IMAGE", "MASK"), ("image", "mask")
    DESCRIPTION = "The people of a picture under another light. mode ratio keeps all detail of the picture."

    @classmethod
    def INPUT_TYPES(cls):
        """Returns the inputs and widgets of the node, in the form that ComfyUI asks for."""
        numbers = {
            "turn": ("FLOAT", {"default": 0.0, "min": -180.0, "max": 180.0, "step": 1.0}),
            "stops": ("FLOAT", {"default": 0.0, "min": -8.0, "max": 8.0, "step": 0.1}),
        }
        choices = {"mode": (["ratio", "full"],), "strength": (["matched to the picture", "its own"],)}
        required = {"image": ("IMAGE",), "light": ("RELIGHT_LIGHT",), **choices, **numbers}
        return {"required": required, "optional": {"mask": ("MASK",), "background": ("IMAGE",)}}

    def run(self, image, light, mode, strength, turn, stops, mask=None, background=None):
        """Relights each picture of an IMAGE.

        Args:
            image: (B,H,W,3) sRGB codes in [0,1].
            light: a `relight.lights.Light`.
            mode: `ratio` keeps all detail of the picture, `full` is albedo * shading.
            strength: of the light, "matched to the picture" or "its own".
            turn: of the light about the vertical, degrees.
            stops: exposure, as a power of two.
            mask: (B,H,W) or (1,H,W), 1 on people; None to find them.
            background: IMAGE with the new backgrounds, used in turn; None keeps the own.

        Returns:
            The relit IMAGE (B,H,W,3), and the MASK (B,H,W) of the people.
        """
        images, alphas = [], []
        options = {"mode": mode, "match": strength == "matched to the picture", "turn": turn, "stops": stops}
        behind = [] if background is None else [picture >> 8 for picture in pictures(background)]
        with tempfile.TemporaryDirectory() as folder:
            for i, (picture, coverage) in enumerate(zip(pictures(image), coverages(mask, len(image)))):
                path = Path(folder) / "background.png"
                if behind:
                    Image.fromarray(behind[i % len(behind)].astype(np.uint8)).save(path)
                place = str(path) if behind else "keep"
                alphas.append(coverage_of_all(relighter().infer(picture, coverage)))
                images.append(relighter().relight(picture, alphas[-1], light.coefficients, background=place, **options))
        return to_image(images), to_image(alphas)


class InferMaps:
    """Albedo, shading and normals of the people of pictures, at the pictures' size."""

    CATEGORY, FUNCTION = CATEGORY, "run"
    RETURN_TYPES, RETURN_NAMES = ("IMAGE", "IMAGE", "MASK", "IMAGE"), ("albedo", "shading", "mask", "normal")
    DESCRIPTION = (
        "What the network infers, 0 where nobody is. The shading is shown at half its strength. Normals are mean "
        "unoccluded directions as in OpenGL, (n + 1) / 2, toward the camera where nobody is."
    )

    @classmethod
    def INPUT_TYPES(cls):
        """Returns the inputs and widgets of the node, in the form that ComfyUI asks for."""
        return {"required": {"image": ("IMAGE",)}, "optional": {"mask": ("MASK",)}}

    def run(self, image, mask=None):
        """Returns for an IMAGE, and the MASK of its people or None, what `infer_maps` returns, as IMAGEs and a MASK."""
        maps = [infer_maps(*pair) for pair in zip(pictures(image), coverages(mask, len(image)))]
        return tuple(to_image(kind) for kind in zip(*maps))


def infer_maps(picture, coverage):
    """Returns what the network infers about a picture, resampled to its pixels as `relight photo --maps` writes it.

    Args:
        picture: (H,W,3) uint16 sRGB.
        coverage: (H,W) uint8 of the people, or None to find it.

    Returns:
        Albedo (H,W,3) and half the shading (H,W,3), sRGB codes in [0,1]; coverage (H,W) in [0,1]; and normals (H,W,3)
        coded as (n + 1) / 2.
    """
    import OpenEXR

    from relight import srgb
    from relight.cli import app

    with tempfile.TemporaryDirectory() as folder:
        photo, words = Path(folder) / "photo.png", []
        Image.fromarray((picture >> 8).astype(np.uint8)).save(photo)
        if coverage is not None:
            Image.fromarray(coverage).save(Path(folder) / "mask.png")
            words = ["--mask", str(Path(folder) / "mask.png")]
        app(["photo", str(photo), "--maps", "--out", str(Path(folder) / "out"), *words], standalone_mode=False)
        file = OpenEXR.File(str(Path(folder) / "out" / "maps.exr"), separate_channels=True)
        (left, top), (right, bottom) = file.header()["dataWindow"]
        channels = {name: channel.pixels for name, channel in file.channels().items()}

    def whole(*names):
        """Returns channels of the file by name, (H,W,number of names), at the size of the picture."""
        values = np.zeros((*picture.shape[:2], len(names)), np.float32)
        values[top : bottom + 1, left : right + 1] = np.stack([channels[name] for name in names], -1)
        return values

    albedo, shading = (whole(*(f"{layer}.{c}" for c in "RGB")) for layer in ("albedo", "shading"))
    shown = (srgb.encode(values.clip(0, 1)) for values in (albedo, DISPLAY_STRENGTH * shading))
    coverage, normal = whole("coverage.A")[..., 0], whole("normal.X", "normal.Y", "normal.Z")
    normal[coverage == 0] = 0, 0, 1
    return (*shown, coverage, (normal + 1) / 2)


NODE_CLASS_MAPPINGS = {
    "RelightFindMask": FindMask,
    "RelightNamedLight": NamedLight,
    "RelightPanoramaLight": PanoramaLight,
    "RelightRelight": Relight,
    "RelightInferMaps": InferMaps,
}
NODE_DISPLAY_NAME_MAPPINGS = {
    "RelightFindMask": "Mask of people",
    "RelightNamedLight": "Light by name",
    "RelightPanoramaLight": "Light of a panorama",
    "RelightRelight": "Relight people",
    "RelightInferMaps": "Albedo, shading and normals of people",
}
