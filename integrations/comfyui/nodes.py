"""The nodes: mask of people, lights, the relit picture, and albedo, shading and normals.

As in all of ComfyUI, IMAGE is a float tensor (B,H,W,3) of sRGB codes, and MASK (B,H,W) in [0,1]; here 1 is a person.
RELIGHT_LIGHT is a `relight.lights.Light`. torch is ComfyUI's own; relight computes with NumPy and ONNX Runtime.
"""

import hashlib
import logging
from functools import cache, lru_cache, partial
from pathlib import Path

import comfy.model_management
import comfy.utils
import numpy as np
import torch

from relight.core import srgb
from relight.core.errors import UserError
from relight.lights import Light
from relight.lights.light import parts_of
from relight.lights.place import is_of_person, split_place
from relight.maps.square import tiles
from relight.panoramas import Panorama, project
from relight.photos.api import load
from relight.photos.look import Look
from relight.photos.mask.find import NobodyFound, masked
from relight.photos.shading import shade
from relight.photos.write import placed_maps
from relight.pictures.picture import Picture
from relight.sh import mean_direction

MEMORY = 32_000_000  # pixels whose scenes are kept, so that turning a light is quick: an inference takes CPU-seconds
LIGHT = "RELIGHT_LIGHT"  # type of a `relight.lights.Light` in ComfyUI
DISPLAY_STRENGTH = 0.5  # shading may exceed 1: half of it is shown
SCENES = {}  # by `scene_of`, the oldest first
NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS = {}, {}
IMAGE = ("IMAGE", {"tooltip": "Pictures, one or a batch."})
MASK = ("MASK", {"tooltip": "White on the people: one for all pictures, or one for each. Found if none is given."})
NAMES = "A name as in the description, or the path of a file on ComfyUI's machine."
ENCODING = (["sRGB", "linear"], {"tooltip": "Linear if it comes from a loader of EXR or HDR files."})
KNOWN = (LIGHT, {"tooltip": "The picture's own light, if you know it; by default it is inferred."})
BEHIND = ("IMAGE", {"tooltip": "Behind the people, in turn."})
relighter = cache(load)  # of the weights that come with relight


def scene_of(pixels, coverage, lit_by=None):
    """Infers the people of a picture (H,W,3), uint16 sRGB or float32 linear, once; coverage is (H,W) uint8 or None."""
    parts = pixels, coverage, lit_by and lit_by.coefficients
    key = pixels.shape, *(part is not None and hashlib.blake2b(np.ascontiguousarray(part)).digest() for part in parts)
    if key not in SCENES:
        scene = relighter().scene(pixels, coverage, lit_by=lit_by)
        while SCENES and sum(kept.picture.pixels.size for kept in [scene, *SCENES.values()]) > 3 * MEMORY:
            del SCENES[next(iter(SCENES))]
        SCENES[key] = scene
        log(scene.notes)
    return SCENES[key]


def log(notes):
    """Shows notes in ComfyUI's console."""
    for note in notes:
        logging.warning("relight: %s", note)


def each(image, mask, encoding, find):
    """Yields the index of each picture of an IMAGE that shows people, and what `find` returns for it (as `scene_of`).

    Between pictures the user may interrupt. What shows nobody is named in the console.
    """
    bar = comfy.utils.ProgressBar(len(image))
    for i, (picture, coverage) in enumerate(zip(image, coverages(mask, image.shape[:3]))):
        comfy.model_management.throw_exception_if_processing_interrupted()
        try:
            yield i, find(pixels_of(picture, encoding), coverage)
        except NobodyFound as error:
            log([f"picture {i + 1} of {len(image)} is passed on as it is: {error}"])
        bar.update(1)


def pixels_of(picture, encoding):
    """Returns a picture (H,W,C) as (H,W,3) uint16 sRGB, or as float32 linear if it is linear or has values above 1."""
    if encoding == "linear" or not picture[..., :3].max() <= 1:
        return linear_of(picture, encoding)
    pixels = np.empty((*picture.shape[:2], 3), np.uint16)
    for window in tiles((0, len(pixels)), (0, pixels.shape[1])):
        pixels[window] = (65535 * picture[window][..., :3].float().clamp_min(0)).round().cpu().numpy()
    return pixels


def linear_of(picture, encoding):
    """Returns a picture (H,W,C) as (H,W,3) float32 linear; sRGB codes above 1 go on along the curve."""
    values = picture[..., :3].float().cpu().numpy()
    return (srgb.decode(values) if encoding == "sRGB" else values).astype(np.float32)


def encoded(linear, encoding):
    """Returns linear values as `linear_of` takes them."""
    return linear if encoding == "linear" else srgb.encode(linear) + 1.055 * (np.maximum(linear, 1) ** (1 / 2.4) - 1)


def coverages(mask, shape):
    """Returns coverages (H,W) uint8 of the pictures of an IMAGE of `shape` (B,H,W) by a MASK of any size, or Nones."""
    count, *size = shape
    if mask is None:
        return [None] * count
    masks = mask.reshape(-1, 1, *mask.shape[-2:]).float().cpu()
    if len(masks) not in (1, count):
        raise ValueError(f"there are {len(masks)} masks for {count} pictures: give one, or one for each")
    if list(masks.shape[-2:]) != size:  # as ComfyUI does it
        masks = torch.nn.functional.interpolate(masks, size=size, mode="bilinear")
    return (255 * masks[:, 0].clamp(0, 1)).round().to(torch.uint8).expand(count, *size).numpy()


def node(key, title, returns, optional=None, **required):
    """Makes a node of ComfyUI of a method and its docstring; `returns` has the types of its results by their names."""

    def register(run):
        inputs = {"required": required, "optional": optional or {}}
        parts = {"CATEGORY": "relight", "FUNCTION": "run", "DESCRIPTION": " ".join(run.__doc__.split()), "run": run}
        parts |= {"RETURN_NAMES": tuple(returns), "RETURN_TYPES": tuple(returns.values())}
        parts["INPUT_TYPES"] = classmethod(lambda cls: inputs)
        NODE_DISPLAY_NAME_MAPPINGS[key], NODE_CLASS_MAPPINGS[key] = title, type(key, (), parts)
        return run

    return register


@node("RelightFindMask", "Mask of people", {"mask": "MASK"}, {"encoding": ENCODING}, image=IMAGE)
def find_mask(self, image, encoding="sRGB"):
    """White on the people of a picture. Needs `relight mask setup`, once, in ComfyUI's environment."""
    found = torch.zeros(image.shape[:3])
    for i, coverage in each(image, None, encoding, lambda pixels, _: masked(Picture.of(pixels)).coverage):
        found[i] = torch.from_numpy(coverage) / 255
    return (found,)


@node("RelightNamedLight", "Light by name", {"light": LIGHT}, light=("STRING", {"default": "room:7", "tooltip": NAMES}))
def named_light(self, light):
    """room:7, sky:3, lamps:5, key:#ffe6c8@50,40,0.3 (color, degrees right and up, fill), or a file."""
    return (light_of(changed(None, light)),)


def changed(cls, light):
    """Returns a value that differs when the light does: its name, and when the files in it changed."""
    names = [name for part in parts_of(light) for name in (split_place(part)[0], part.rpartition(":")[0])]  # a.npz:12
    return light, *(path.stat().st_mtime_ns for path in map(Path, names) if path.is_file())


@lru_cache(64)
def light_of(state):
    """Reads the light of what `changed` returned, and logs the notes on it."""
    light = relighter().read_light(state[0])
    log(light.notes if light else ())
    return light


def validated(cls, light):
    """Returns True, or what is wrong with a light; one that comes by a link is None, and photos take too long."""
    try:
        if light is not None and not is_of_person(light):
            light_of(changed(cls, light))
    except UserError as error:
        return str(error)
    return True


NODE_CLASS_MAPPINGS["RelightNamedLight"].IS_CHANGED = classmethod(changed)
NODE_CLASS_MAPPINGS["RelightNamedLight"].VALIDATE_INPUTS = classmethod(validated)


@node("RelightPanoramaLight", "Light of a panorama", {"light": LIGHT}, panorama=IMAGE, encoding=ENCODING)
def panorama_light(self, panorama, encoding):
    """Light of a lat-long panorama, whose middle is in front of the camera; of the first, if there are several.
    Negative values count as 0."""
    pixels = linear_of(panorama[0], encoding).clip(0)
    if pixels.shape[1] != 2 * pixels.shape[0]:
        raise ValueError(f"the panorama is {pixels.shape[1]} x {pixels.shape[0]}: give one twice as wide as high")
    panorama = Panorama(pixels)
    return (Light(project(panorama, relighter().network.order), "panorama of ComfyUI", panorama),)


@node(
    "RelightRelight",
    "Relight people",
    {"image": "IMAGE", "mask": "MASK"},
    {"mask": MASK, "background": BEHIND, "encoding": ENCODING, "lit_by": KNOWN},
    image=IMAGE,
    light=(LIGHT, {"tooltip": "The new light."}),
    mode=(["ratio", "full"], {"tooltip": "Ratio keeps all detail of the picture; full is albedo times shading."}),
    strength=(["matched to the picture", "its own"], {"tooltip": "Whether the light takes the picture's exposure."}),
    turn=("FLOAT", {"default": 0.0, "min": -180.0, "max": 180.0, "step": 1.0, "tooltip": "Of the light, degrees."}),
    stops=("FLOAT", {"default": 0.0, "min": -8.0, "max": 8.0, "step": 0.1, "tooltip": "Exposure, powers of two."}),
)
def relight(self, image, light, mode, strength, turn, stops, mask=None, background=None, encoding="sRGB", lit_by=None):
    """The people of a picture under another light. What is not of them stays as it is."""
    behind = ["keep"] if background is None else [pixels_of(picture, encoding) for picture in background]
    looks = [Look(light, mode, picture, turn, stops, strength != "its own") for picture in behind]
    out, alpha = torch.empty(*image.shape[:3], 3), torch.zeros(image.shape[:3])  # filled late: an 8k picture is 768 MB
    for i, scene in each(image, mask, encoding, partial(scene_of, lit_by=lit_by)):
        relit, coverage = scene.relit(looks[i % len(looks)]), scene.picture.coverage
        log(scene.notes_on(looks[0]) if i == 0 else ())
        out[i], alpha[i] = image[i, ..., :3], torch.from_numpy(coverage) / 255
        for window in tiles((0, len(relit)), (0, relit.shape[1])):
            part = relit[window]
            part = part / np.float32(65535) if part.dtype == np.uint16 else encoded(part, encoding)
            own = True if background is not None else coverage[window][..., None] > 0
            np.copyto(out[i][window].numpy(), part, where=own)
    nobody = alpha.amax((1, 2)) == 0
    out[nobody] = image[nobody.to(image.device), ..., :3].float().cpu()
    return out, alpha


@node(
    "RelightInferMaps",
    "Maps of people",
    {"albedo": "IMAGE", "shading": "IMAGE", "mask": "MASK", "normal": "IMAGE"},
    {"mask": MASK, "encoding": ENCODING, "lit_by": KNOWN},
    image=IMAGE,
)
def maps_of(self, image, mask=None, encoding="sRGB", lit_by=None):
    """What the network infers, 0 where nobody is. The shading is shown at half its strength. Normals are mean
    unoccluded directions as in OpenGL, (n + 1) / 2, toward the camera where nobody is."""
    maps = [torch.zeros(*image.shape[:3], 3) for _ in range(3)]
    alpha, maps[2][:] = torch.zeros(image.shape[:3]), torch.tensor([0.5, 0.5, 1])
    for i, scene in each(image, mask, encoding, partial(scene_of, lit_by=lit_by)):
        alpha[i] = torch.from_numpy(scene.picture.coverage) / 255
        for person in scene.people:
            fits = person.fitted_albedo, person.fitted_transport
            for window, own, albedo, transport in placed_maps(person, scene.picture.pixels, fits):
                lit = DISPLAY_STRENGTH * shade(transport, person.light)
                shown = encoded(albedo**2, encoding), encoded(lit, encoding), (mean_direction(transport) + 1) / 2
                for out, values in zip(maps, shown):
                    out[i].numpy()[window][own] = values
    return maps[0], maps[1], alpha, maps[2]
