"""The nodes: mask of people, lights, the relit picture, and albedo, shading and normals.

As in all of ComfyUI, IMAGE is a float tensor (B,H,W,3) of sRGB codes in [0,1], and MASK (B,H,W) in [0,1]; here 1 is a
person. RELIGHT_LIGHT is a `relight.lights.Light`. torch is ComfyUI's own; relight computes with NumPy and ONNX Runtime.
"""

import warnings
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import torch

from relight.core import srgb
from relight.lights import Light
from relight.panoramas import Panorama, project
from relight.photos.api import load
from relight.photos.look import Look
from relight.photos.mask.find import masked
from relight.photos.picture import Picture
from relight.photos.write import layers

MEMORY = 8  # scenes that are kept, so that turning a light is quick: an inference takes CPU-seconds
LIGHT = "RELIGHT_LIGHT"  # type of a `relight.lights.Light` in ComfyUI
MATCHED = "matched to the picture"
NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS = {}, {}
DISPLAY_STRENGTH = 0.5  # shading may exceed 1: half of it is shown


@cache
def relighter():
    """Returns the relighter of the weights that come with relight; reads them at the first call."""
    return load()


@lru_cache(MEMORY)
def scene_of(shape, pixels, coverage):
    """Infers the people of a picture, once, and shows the notes on it.

    Args:
        shape: (H, W).
        pixels: bytes of (H,W,3) uint16 sRGB.
        coverage: bytes of (H,W) uint8; None to find the people.
    """
    mask = None if coverage is None else np.frombuffer(coverage, np.uint8).reshape(shape)
    scene = relighter().scene(np.frombuffer(pixels, np.uint16).reshape(*shape, 3), mask)
    for note in scene.notes:
        warnings.warn(note, stacklevel=2)
    return scene


def scenes(image, mask):
    """Returns the scene of each picture of an IMAGE, with the MASK of its people, or None to find them."""
    return [
        scene_of(picture.shape[:2], picture.tobytes(), None if coverage is None else coverage.tobytes())
        for picture, coverage in zip(pictures(image), coverages(mask, len(image)))
    ]


def pictures(image):
    """Returns the pictures (H,W,3) uint16 of an IMAGE; 16 bits keep what ComfyUI's floats hold beyond 8."""
    return np.round(image[..., :3].cpu().numpy().clip(0, 1) * 65535).astype(np.uint16)


def coverages(mask, count):
    """Returns the coverage (H,W) uint8 of each of `count` pictures by a MASK of one for each or for all, or None."""
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


def infer_maps(scene):
    """Returns what the network infers about a picture, resampled to its pixels as `relight photo --maps` writes it.

    Returns:
        Albedo (H,W,3) and half the shading (H,W,3), sRGB codes in [0,1]; coverage (H,W) in [0,1]; and normals (H,W,3)
        coded as (n + 1) / 2.
    """
    channels, top, left = layers(scene)

    def whole(*names):
        """Returns channels by name, (H,W,number of names), at the size of the picture."""
        part = np.stack([channels[name] for name in names], -1)
        values = np.zeros((*scene.picture.shape, len(names)), np.float32)
        values[top : top + part.shape[0], left : left + part.shape[1]] = part
        return values

    albedo, shading = (whole(*(f"{layer}.{c}" for c in "RGB")) for layer in ("albedo", "shading"))
    shown = (srgb.encode(values.clip(0, 1)) for values in (albedo, DISPLAY_STRENGTH * shading))
    coverage, normal = whole("coverage.A")[..., 0], whole("normal.X", "normal.Y", "normal.Z")
    normal[coverage == 0] = 0, 0, 1
    return (*shown, coverage, (normal + 1) / 2)


def node(key, title, returns, optional=None, **required):
    """Makes a node of ComfyUI of a method, whose docstring is its description.

    Args:
        key: name of the node in workflows.
        title: name in the menu.
        returns: types of the results by their names.
        optional: optional inputs by their names, as ComfyUI asks for them.
        **required: the others.
    """

    def register(run):
        inputs = {"required": required, "optional": optional or {}}
        NODE_DISPLAY_NAME_MAPPINGS[key] = title
        NODE_CLASS_MAPPINGS[key] = type(
            key,
            (),
            {
                "CATEGORY": "relight",
                "FUNCTION": "run",
                "RETURN_NAMES": tuple(returns),
                "RETURN_TYPES": tuple(returns.values()),
                "DESCRIPTION": " ".join(run.__doc__.split()),
                "INPUT_TYPES": classmethod(lambda cls: inputs),
                "run": run,
            },
        )
        return run

    return register


@node("RelightFindMask", "Mask of people", {"mask": "MASK"}, image=("IMAGE",))
def find_mask(self, image):
    """White on the people of a picture. Needs `relight mask setup`, once, in ComfyUI's environment."""
    return (to_image([masked(Picture.of(picture)).coverage for picture in pictures(image)]),)


@node("RelightNamedLight", "Light by name", {"light": LIGHT}, light=("STRING", {"default": "room:7"}))
def named_light(self, light):
    """room:7, sky:3, lamps:5, key:#ffd9a0@70,20,0.15 (color, degrees right and up, fill), or a file."""
    return (relighter().read_light(light),)


def changed(cls, light):
    """Returns a value that differs when the light does: for a file, its name and its time of change."""
    path = Path(light)
    return (light, path.stat().st_mtime_ns) if path.is_file() else light


NODE_CLASS_MAPPINGS["RelightNamedLight"].IS_CHANGED = classmethod(changed)


@node(
    "RelightPanoramaLight",
    "Light of a panorama",
    {"light": LIGHT},
    panorama=("IMAGE",),
    encoding=(["sRGB", "linear"],),
)
def panorama_light(self, panorama, encoding):
    """Light of a lat-long panorama, whose middle is in front of the camera; of the first, if there are several.
    Choose linear if it comes from a loader of EXR or HDR files. Negative values count as 0."""
    values = panorama[0, ..., :3].cpu().numpy().astype(np.float32)
    if values.shape[1] != 2 * values.shape[0]:
        raise ValueError(f"the panorama is {values.shape[1]} x {values.shape[0]}: give one twice as wide as high")
    pixels = srgb.decode(values.clip(0, 1)).astype(np.float32) if encoding == "sRGB" else values.clip(0)
    panorama = Panorama(pixels, source="panorama of ComfyUI")
    return (Light(project(panorama, relighter().order), panorama.source, panorama),)


@node(
    "RelightRelight",
    "Relight people",
    {"image": "IMAGE", "mask": "MASK"},
    {"mask": ("MASK",), "background": ("IMAGE",)},
    image=("IMAGE",),
    light=(LIGHT,),
    mode=(["ratio", "full"],),
    strength=([MATCHED, "its own"],),
    turn=("FLOAT", {"default": 0.0, "min": -180.0, "max": 180.0, "step": 1.0}),
    stops=("FLOAT", {"default": 0.0, "min": -8.0, "max": 8.0, "step": 0.1}),
)
def relight(self, image, light, mode, strength, turn, stops, mask=None, background=None):
    """The people of a picture under another light. Mode ratio keeps all detail of the picture. The mask is found if
    none is given; several backgrounds are used in turn."""
    behind = ["keep"] if background is None else pictures(background)
    looks = [Look(light, mode, picture, turn, stops, strength == MATCHED) for picture in behind]
    found = scenes(image, mask)
    images = [scene.relit(looks[i % len(looks)]) for i, scene in enumerate(found)]
    return to_image(images), to_image([scene.picture.coverage for scene in found])


@node(
    "RelightInferMaps",
    "Albedo, shading and normals of people",
    {"albedo": "IMAGE", "shading": "IMAGE", "mask": "MASK", "normal": "IMAGE"},
    {"mask": ("MASK",)},
    image=("IMAGE",),
)
def maps_of(self, image, mask=None):
    """What the network infers, 0 where nobody is. The shading is shown at half its strength. Normals are mean
    unoccluded directions as in OpenGL, (n + 1) / 2, toward the camera where nobody is."""
    return tuple(to_image(kind) for kind in zip(*map(infer_maps, scenes(image, mask))))
