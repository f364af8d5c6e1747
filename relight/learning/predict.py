"""Inference on NumPy arrays."""

import numpy as np
import torch

from relight.core.errors import UserError
from relight.learning.color import shade
from relight.learning.networks import Network, with_transport


def predict(network: Network, image: np.ndarray, mask: np.ndarray) -> dict[str, np.ndarray]:
    """Infers the maps and the light of one image or of several.

    Args:
        network: in evaluation mode.
        image: (S,S,3) or (B,S,S,3), linear, about [0,1], in the color model of the training (`train.color`).
            S is the size that the network was trained for. Values outside the mask do not matter.
        mask: (S,S) or (B,S,S), float or bool.

    Returns:
        float32 arrays with the leading axis of the input: `albedo` (S,S,3) in [0,1]; `transport` (S,S,K); `light`
        (K,3); `shading` (S,S,3), transport . light in [0,10]; `normal` (S,S,3) and `ao` (S,S,1) if the
        network infers them. Maps are zero outside the mask.

    Raises:
        UserError: if the size does not fit the network.
    """
    image, mask = np.asarray(image, np.float32), np.asarray(mask, np.float32)
    if image.ndim == 3:
        return {name: array[0] for name, array in predict(network, image[None], mask[None]).items()}
    if image.shape != (*mask.shape, 3) or image.shape[1] != network.size or image.shape[2] != network.size:
        raise UserError(
            f"image {image.shape[1:]} with mask {mask.shape[1:]}: this network takes {network.size}x{network.size} px"
        )
    device = next(network.parameters()).device
    pictures, inside = (torch.from_numpy(x).to(device) for x in (image, mask[..., None]))
    with torch.inference_mode():
        outputs = network(pictures.permute(0, 3, 1, 2), inside.permute(0, 3, 1, 2))
        light = outputs.pop("light").float()
        maps = {name: dense.permute(0, 2, 3, 1).float() for name, dense in outputs.items()}
        maps = {name: values * inside for name, values in with_transport(maps, network.order).items()}
        shading = shade(maps["transport"].flatten(1, 2), light).view(image.shape)
    # A parameter itself, or a view of one, requires gradients even there.
    return {
        name: tensor.detach().cpu().numpy() for name, tensor in {**maps, "light": light, "shading": shading}.items()
    }
