"""What a network infers of a test figure, as maps like those that are baked."""

from dataclasses import replace

import numpy as np

from relight.evaluation.evaluate import infer
from relight.learning.data import RelitSet
from relight.learning.networks import Network
from relight.maps import Maps
from relight.sh import coefficient_count, unoccluded
from relight.srgb import decode


def inferred_maps(network: Network, data: RelitSet, light: int, true: Maps) -> Maps:
    """Infers the maps of a figure from its picture under one light.

    Args:
        network: of any kind; what no loss of its training asked for stays true.
        data: its test set.
        light: index of the light in the set.
        true: the figure's baked maps, whose info names it in the set.

    Returns:
        Maps with the mask of `true`. The albedo is linear: that of networks of `train.color=paper`, which take codes as
        linear values, is decoded. The ambient occlusion is that of the transport; normals that are not inferred are 0.
    """
    (figure,) = data.figures([true.info["name"]])
    inferred = infer(network, data, int(figure), np.array([light]))
    start, count = int(data.offset[figure]), int(data.counts[figure])
    pixel = data.pixel[start : start + count].cpu().numpy()
    transport = inferred.transport[0][:, : coefficient_count(2)]
    if inferred.occlude:
        transport = transport * inferred.ao[0][:, None]
    most = unoccluded(np.array([0.0, 0, 1]), 0)[0]  # T00 of a point that nothing occludes
    albedo = inferred.albedo
    if albedo is not None:
        albedo = decode(np.clip(albedo[0], 0, 1)) if data.color == "paper" else np.clip(albedo[0], 0, 1)

    def dense(values: np.ndarray) -> np.ndarray:
        """(P,C) -> (S,S,C), zero outside the mask."""
        image = np.zeros((data.size**2, values.shape[-1]), np.float32)
        image[pixel] = values
        return image.reshape(data.size, data.size, -1)

    return replace(
        true,
        albedo=true.albedo if albedo is None else dense(albedo),
        normal=np.zeros_like(true.normal) if inferred.normal is None else dense(inferred.normal[0]),
        ao=dense(np.clip(transport[:, :1] / most, 0, 1))[..., 0],
        transport=dense(transport),
        bounced=None,
    )
