"""The nodes: mask of people, lights, the relit picture, and albedo, shading and normals.

As in all of ComfyUI, IMAGE is a float tensor (B,H,W,3) of sRGB codes, and MASK (B,H,W) in [0,1]; here 1 is a person.
RELIGHT_LIGHT is a `relight.lights.Light`. torch is ComfyUI's own; relight computes with NumPy and ONNX Runtime.
"""

import logging
import os
from dataclasses import replace
from functools import cache, wraps
from inspect import signature

import comfy.model_management
import comfy.utils
import folder_paths
import numpy as np
import torch
from server import PromptServer
from torch.utils.weak import WeakTensorKeyDictionary

from relight.core import srgb
from relight.lights import Light
from relight.lights.light import parts_of, total
from relight.lights.place import split_place
from relight.lights.show import lit_ball
from relight.maps.square import MASK_THRESHOLD
from relight.panoramas import Panorama, orient, project
from relight.photos.api import load
from relight.photos.inferred import read_light
from relight.photos.look import Look
from relight.photos.mask.find import NobodyFound, masked
from relight.photos.write import placed_maps
from relight.pictures.picture import Picture
from relight.sh import mean_direction

MEMORY = 32_000_000  # pixels of an IMAGE whose scenes are kept: an inference takes CPU-seconds, another light does not
LIGHT = "RELIGHT_LIGHT"  # type of a `relight.lights.Light` in ComfyUI
SCENES = WeakTensorKeyDictionary()  # of an IMAGE, until ComfyUI frees it: mask, own light, encoding and its scenes
NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS = {}, {}
INPUTS = {  # by their names in the nodes' methods
    "image": ("IMAGE", {"tooltip": "Pictures, one or a batch."}),
    "mask": ("MASK", {"tooltip": "White on the people: one for all pictures, or one each. Found if none is given."}),
    "background": ("IMAGE", {"tooltip": "Behind the people, in turn."}),
    "encoding": (["sRGB", "linear"], {"tooltip": "Linear if it comes from a loader of EXR or HDR files."}),
    "name": ("STRING", {"default": "room:7", "tooltip": "As described; or a file in the input folder, or elsewhere."}),
    "panorama": ("IMAGE", {"tooltip": "Twice as wide as high."}),
    "light": (LIGHT, {"tooltip": "The new light."}),
    "other": (LIGHT, {"tooltip": "Added as it is."}),
    "lit_by": (LIGHT, {"tooltip": "The picture's own light, if you know it; by default it is inferred."}),
    "mode": (["ratio", "full"], {"tooltip": "Ratio keeps all detail of the picture; full is albedo times shading."}),
    "strength": (["matched to the picture", "its own"], {"tooltip": "If the light takes the picture's exposure."}),
    "turn": ("FLOAT", {"default": 0.0, "min": -180.0, "max": 180.0, "step": 1.0, "tooltip": "Of the light, degrees."}),
    "stops": ("FLOAT", {"default": 0.0, "min": -8.0, "max": 8.0, "step": 0.1, "tooltip": "Exposure, powers of two."}),
}
MAPS = {"albedo": "IMAGE", "shading": "IMAGE", "mask": "MASK", "normal": "IMAGE"}
relighter = cache(load)  # of the weights that come with relight


def inferred(image, mask, lit_by, encoding):
    """Returns a function of a picture's index and coverage that infers its scene, or takes the one that is kept."""
    kept = SCENES.get(image)
    if not kept or kept[0] is not mask or kept[1] is not lit_by or kept[2] != encoding:
        kept = SCENES[image] = mask, lit_by, encoding, {}

    def find(i, coverage):
        scene = kept[3].get(i) or relighter().scene(pixels_of(image[i], encoding), coverage, lit_by=lit_by)
        if image[..., 0].numel() <= MEMORY:
            kept[3][i] = scene
        return scene

    return find


def each(node, image, mask, find):
    """Yields the index of each picture of an IMAGE that shows people, and what `find` returns of that and its coverage.

    Between pictures the user may interrupt. What is to be told of the pictures goes to the node's notes, once.
    """
    bar, told = comfy.utils.ProgressBar(len(image)), {}
    for i, coverage in enumerate(coverages(mask, image.shape[:3])):
        comfy.model_management.throw_exception_if_processing_interrupted()
        if coverage is not None and coverage.min() >= MASK_THRESHOLD:
            raise ValueError(f"the mask of picture {i + 1} is white everywhere: make it white on the people alone")
        try:
            found = find(i, coverage)
            yield i, found
            notes = [note.partition("; `relight")[0] for note in found.notes]  # no commands here
        except NobodyFound as error:
            notes = [f"passed on as it is: {error}"]
        for note in notes:
            told.setdefault(note, []).append(str(i + 1))
        bar.update(1)
    node.notes += [f"picture {', '.join(which)} of {len(image)}: {note}" for note, which in told.items()]


def pixels_of(picture, encoding):
    """Returns a picture (H,W,C) as (H,W,3) uint16 sRGB, or as float32 linear if it is linear or has values above 1."""
    values = picture[..., :3].float().cpu().numpy()
    if encoding == "sRGB" and values.max() <= 1:
        return np.round(values.clip(0) * np.float32(65535)).astype(np.uint16)
    return (srgb.decode(values) if encoding == "sRGB" else values).astype(np.float32)


def encoded(linear, encoding):
    """Returns linear values as `pixels_of` takes them."""
    return linear if encoding == "linear" else srgb.encode(linear) + 1.055 * (np.maximum(linear, 1) ** (1 / 2.4) - 1)


def coverages(mask, shape):
    """Returns coverages (H,W) uint8 of the pictures of an IMAGE of `shape` (B,H,W) by a MASK of any size, or Nones."""
    count, *size = shape
    if mask is None:
        return [None] * count
    masks = mask.reshape(-1, 1, *mask.shape[-2:]).float().cpu()
    if len(masks) not in (1, count):
        raise ValueError(f"there are {len(masks)} masks for {count} pictures: give one, or one for each")
    masks = torch.nn.functional.interpolate(masks, size=size, mode="bilinear")  # as ComfyUI does it
    return (255 * masks[:, 0].clamp(0, 1)).round().to(torch.uint8).expand(count, *size).numpy()


def node(key, title, aliases, **returns):
    """Makes a node of ComfyUI of a method and its docstring; `returns` has the types of its results by their names."""

    def register(run):
        @wraps(run)
        def run_and_tell(self, *values, unique_id=None, **given):
            self.notes = []
            try:
                return run(self, *values, **given)
            finally:
                for note in (notes := dict.fromkeys(self.notes)):
                    logging.warning("relight: %s", note)
                PromptServer.instance.send_progress_text("\n".join(notes), unique_id)

        inputs = {"required": {}, "optional": {}, "hidden": {"unique_id": "UNIQUE_ID"}}
        for name, given in [*signature(run).parameters.items()][1:]:
            inputs["required" if given.default is given.empty else "optional"][name] = INPUTS[name]
        parts = {"CATEGORY": "relight", "FUNCTION": "run", "DESCRIPTION": " ".join(run.__doc__.split())}
        parts |= {"run": run_and_tell, "SEARCH_ALIASES": aliases.split(", "), "RETURN_NAMES": tuple(returns)}
        parts |= {"RETURN_TYPES": tuple(returns.values()), "OUTPUT_TOOLTIPS": (parts["DESCRIPTION"],) * len(returns)}
        parts["INPUT_TYPES"] = classmethod(lambda cls: inputs)
        NODE_DISPLAY_NAME_MAPPINGS[key], NODE_CLASS_MAPPINGS[key] = title, type(key, (), parts)
        return run

    return register


@node("RelightFindMask", "Mask of people", "segment, matte", mask="MASK")
def find_mask(self, image, encoding="sRGB"):
    """White on the people of a picture. Needs `relight mask setup`, once, in ComfyUI's environment."""
    found = torch.zeros(image.shape[:3])
    for i, one in each(self, image, None, lambda i, _: masked(Picture.of(pixels_of(image[i], encoding)))):
        found[i] = torch.from_numpy(one.coverage) / 255
    return (found,)


@node("RelightNamedLight", "Light by name", "hdri, lamp", light=LIGHT)
def named_light(self, name):
    """A name, such as room:7 or key:#ffe6c8@50,40,0.3 (docs/lights.md has all), or a file."""
    light = read_light(changed(None, name)[0], relighter().network)
    self.notes += light.notes if light else ()  # `auto` is none
    return (light,)


def changed(cls, name, **hidden):
    """Returns a value that differs when a light does: its path, and when the files in it changed; None by a link."""
    if name is None:
        return None
    name = own if os.path.isfile(own := os.path.join(folder_paths.get_input_directory(), name)) else name
    files = [file for part in parts_of(name) for file in (split_place(part)[0], part.rpartition(":")[0])]  # a.npz:12
    return name, *(os.stat(file).st_mtime_ns for file in files if os.path.isfile(file))


NODE_CLASS_MAPPINGS["RelightNamedLight"].IS_CHANGED = classmethod(changed)


@node("RelightPanoramaLight", "Light of a panorama", "hdri", light=LIGHT)
def panorama_light(self, panorama, encoding):
    """Light of a lat-long panorama, whose middle is in front of the camera; of the first, if there are several."""
    pixels = srgb.to_linear(pixels_of(panorama[0], encoding)).clip(0)
    if pixels.shape[1] != 2 * pixels.shape[0]:
        raise ValueError(f"the panorama is {pixels.shape[1]} x {pixels.shape[0]}: give one twice as wide as high")
    return (Light(project(Panorama(pixels), relighter().network.order), "panorama of ComfyUI"),)


@node("RelightCombineLights", "Turn and add lights", "rotate light, preview", light=LIGHT, ball="IMAGE")
def combine_lights(self, light, turn, stops, other=None):
    """A light that is turned about the vertical and made brighter, plus another; and a white ball in it."""
    if light is None:
        raise ValueError("auto is chosen for each picture: give another light to be turned or added to")
    light = replace(light, coefficients=orient(light.coefficients, turn) * 2.0**stops, panorama=None)
    light = total([light, other], f"{light} + {other}") if other else light
    return light, torch.from_numpy(np.float32(lit_ball(light.coefficients, 256)))[None]


@node("RelightRelight", "Relight people", "relighting, light, shadow, delight", image="IMAGE", mask="MASK")
def relight(self, image, light, mode, strength, turn, stops, mask=None, background=None, encoding="sRGB", lit_by=None):
    """The people of a picture under another light, and their mask. What is not of them stays as it is."""
    behind = ["keep"] if background is None else [pixels_of(picture, encoding) for picture in background]
    looks = [Look(light, mode, picture, turn, stops, strength != "its own") for picture in behind]
    out, alpha = image[..., :3].float().cpu().clone(), torch.zeros(image.shape[:3])
    for i, scene in each(self, image, mask, inferred(image, mask, lit_by, encoding)):
        relit, coverage = scene.relit(looks[i % len(looks)]), scene.picture.coverage
        self.notes += scene.notes_on(looks[0])
        alpha[i] = torch.from_numpy(coverage) / 255
        relit = relit / np.float32(65535) if relit.dtype == np.uint16 else encoded(relit, encoding)
        np.copyto(out[i].numpy(), relit, where=(coverage[..., None] > 0) | (background is not None))
    return out, alpha


@node("RelightInferMaps", "Maps of people", "albedo, normal map, shading, intrinsic", **MAPS)
def maps_of(self, image, mask=None, encoding="sRGB", lit_by=None):
    """What the network infers, 0 where nobody is: albedo, shading at half its strength, and mask. Normals are mean
    unoccluded directions as in OpenGL, (n + 1) / 2, toward the camera where nobody is."""
    alpha, maps = torch.zeros(image.shape[:3]), [torch.zeros(*image.shape[:3], 3) for _ in range(3)]
    for i, scene in each(self, image, mask, inferred(image, mask, lit_by, encoding)):
        alpha[i] = torch.from_numpy(scene.picture.coverage) / 255
        for person in scene.people:
            fits = person.fitted_albedo, person.fit(np.concatenate([person.transport[..., :4], person.shading], -1))
            for window, own, share, albedo, others in placed_maps(person, scene.people, scene.picture.pixels, fits):
                lit = np.maximum(others[..., 4:], 0) / 2  # it may exceed 1
                shown = encoded(albedo**2, encoding), encoded(lit, encoding), (mean_direction(others) + 1) / 2
                for out, values in zip(maps, shown):
                    out[i].numpy()[window][own] += share * values
    maps[2][~maps[2].any(-1)] = torch.tensor([0.5, 0.5, 1])
    return maps[0], maps[1], alpha, maps[2]
