"""Inference on NumPy arrays."""

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from relight.core.errors import UserError
from relight.learning.color import shade
from relight.learning.harmonics import mirror_signs
from relight.learning.networks import Network, with_transport


def predict(network: Network, image: np.ndarray, mask: np.ndarray, mirrored: bool = False) -> dict[str, np.ndarray]:
    """Infers the maps and the light of one image or of several.

    Args:
        network: in evaluation mode.
        image: (S,S,3) or (B,S,S,3), linear, about [0,1], in the color model of the training (`train.color`).
            S is the size that the network was trained for. Values outside the mask do not matter.
        mask: (S,S) or (B,S,S), float or bool.
        mirrored: average with the prediction for the mirror image. This makes predictions equivariant to mirroring, at
            twice the cost.

    Returns:
        float32 arrays with the leading axis of the input: `albedo` (S,S,3) in [0,1]; `transport` (S,S,K); `light`
        (K,3); `shading` (S,S,3), transport . light in [0,10]; `normal` (S,S,3) and `ao` (S,S,1) if the
        network infers them. Maps are zero outside the mask.

    Raises:
        UserError: if the size does not fit the network.
    """
    image, mask = np.asarray(image, np.float32), np.asarray(mask, np.float32)
    if image.ndim == 3:
        return {name: array[0] for name, array in predict(network, image[None], mask[None], mirrored).items()}
    if image.shape != (*mask.shape, 3) or image.shape[1] != network.size or image.shape[2] != network.size:
        raise UserError(
            f"image {image.shape[1:]} with mask {mask.shape[1:]}: this network takes {network.size}x{network.size} px"
        )
    device = next(network.parameters()).device
    pictures, inside = (torch.from_numpy(x).to(device) for x in (image, mask[..., None]))
    with torch.inference_mode():
        maps = _maps(network, pictures, inside)
        if mirrored:
            other = _unmirrored(_maps(network, pictures.flip(2), inside.flip(2)), network.order)
            maps = {name: (values + other[name]) / 2 for name, values in maps.items()}
            if "normal" in maps:
                maps["normal"] = F.normalize(maps["normal"], dim=-1)
        maps["shading"] = shade(maps["transport"].flatten(1, 2), maps["light"]).view(image.shape)
    # A parameter itself, or a view of one, requires gradients even there.
    return {name: tensor.detach().cpu().numpy() for name, tensor in maps.items()}


def _maps(network: Network, image: Tensor, inside: Tensor) -> dict[str, Tensor]:
    """Infers light (B,K,3) and maps (B,S,S,C), zero outside the mask, from images (B,S,S,3) and masks (B,S,S,1)."""
    outputs = network(image.permute(0, 3, 1, 2), inside.permute(0, 3, 1, 2))
    light = outputs.pop("light").float()
    maps = {name: dense.permute(0, 2, 3, 1).float() for name, dense in outputs.items()}
    maps = with_transport(maps, network.order)
    return {name: values * inside for name, values in maps.items()} | {"light": light}


def _unmirrored(maps: dict[str, Tensor], order: int) -> dict[str, Tensor]:
    """Returns the maps of an image, given those of its mirror image.

    `maps` has (B,S,S,C) by name, and `light` (B,K,3). Columns are reversed, and what changes its sign under x -> -x is
    negated: the x of normals, and the coefficients of transport and light that are odd in x.
    """
    signs = {"transport": mirror_signs(order), "light": mirror_signs(order)[:, None], "normal": torch.ones(3)}
    signs["normal"][0] = -1  # x
    flipped = {name: values if name == "light" else values.flip(2) for name, values in maps.items()}
    return {name: values * signs[name].to(values) if name in signs else values for name, values in flipped.items()}
