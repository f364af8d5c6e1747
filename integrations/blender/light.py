"""The light of Blender's world in spherical harmonics of order 2.

The harmonics are those of relight: real, orthonormal, without the Condon-Shortley phase, index l*l + l + m, pole +z.
"""

from math import ceil

import numpy as np

ROWS = 64  # of the panorama that is projected: order 2 needs no finer one


def basis(directions):
    """Returns the harmonics Y_lm (...,9) of order 2 of unit vectors (...,3), index l*l + l + m."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    values = [0.28209479 * np.ones_like(x), 0.48860251 * y, 0.48860251 * z, 0.48860251 * x]
    values += [1.09254843 * x * y, 1.09254843 * y * z, 0.31539157 * (3 * z * z - 1), 1.09254843 * x * z]
    return np.stack([*values, 0.54627422 * (x * x - y * y)], -1)


def sphere(rows=ROWS):
    """Samples the sphere as Blender's lat-long panoramas do: +z is at the top, -x in the leftmost column.

    Returns:
        Directions (rows,2 rows,3), the top row first, and the solid angle (rows,1) of each.
    """
    edges = np.pi * (0.5 - np.arange(rows + 1) / rows)  # elevations between the rows
    elevation = (edges[:-1] + edges[1:]) / 2
    azimuth = np.pi - 2 * np.pi * (np.arange(2 * rows) + 0.5) / (2 * rows)
    horizontal = np.cos(elevation)[:, None]
    z = np.broadcast_to(np.sin(elevation)[:, None], (rows, 2 * rows))
    solid_angle = (np.sin(edges[:-1]) - np.sin(edges[1:])) * np.pi / rows
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), z], -1), solid_angle[:, None]


def project(world, axes):
    """Projects a world's light.

    Args:
        world: a `bpy.types.World`, or None for darkness.
        axes: (3,3), whose rows are the axes of the wanted frame in those of the scene.

    Returns:
        Radiance coefficients (9,3).
    """
    directions, solid_angle = sphere()
    radiance, turn = radiance_of(world, len(directions))
    in_frame = directions @ turn.T @ np.asarray(axes, np.float64).T
    return np.einsum("hwk,hwc,hw->kc", basis(in_frame), radiance, np.broadcast_to(solid_angle, radiance.shape[:2]))


def radiance_of(world, rows):
    """Returns the radiance (rows,2 rows,3) of a world, and the rotation (3,3) from its panorama to the scene."""
    white = np.ones((rows, 2 * rows, 3))
    background, image, color, turn = look_up(world)
    if background is None:
        return white * (0 if world is None else np.array(world.color)), np.eye(3)
    strength = background.inputs["Strength"].default_value
    if image is None:
        return white * strength * np.array(color[:3]), np.eye(3)
    return strength * shrunk(linear_pixels(image), rows), turn


def look_up(world):
    """Finds what a world shines with.

    Returns:
        Its Background node, or None; the image of the panorama that is linked to the node, or None; the node's color
        (4,), or None without a node; and the rotation (3,3) from the panorama to the scene.
    """
    nodes = world.node_tree.nodes if world and world.node_tree else ()
    background = next((node for node in nodes if node.type == "BACKGROUND"), None)
    if background is None:
        return None, None, None, np.eye(3)
    socket, turn = background.inputs["Color"], np.eye(3)
    source = socket.links[0].from_node if socket.links else None
    image = getattr(source, "image", None) if source and source.type == "TEX_ENVIRONMENT" else None
    if image and source.inputs["Vector"].links:
        mapping = source.inputs["Vector"].links[0].from_node
        if mapping.type == "MAPPING":  # it takes a direction of the scene to one of the panorama
            turn = np.array(mapping.inputs["Rotation"].default_value.to_matrix()).T
    return background, image, socket.default_value, turn


def linear_pixels(image):
    """Returns the linear pixels (H,W,3) of a Blender image, the top row first; raises ValueError if it has none."""
    width, height = image.size
    if not width:
        raise ValueError(f"the panorama {image.name} has no pixels: its file is missing")
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    values = values.reshape(height, width, image.channels)[::-1]
    values = values[..., :3] if image.channels >= 3 else np.repeat(values[..., :1], 3, -1)
    if image.is_float or image.colorspace_settings.name != "sRGB":
        return values
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def shrunk(pixels, rows):
    """Shrinks a lat-long panorama (H,W,3) to the means (rows,2 rows,3) over its parts.

    Each pixel counts in the part of its left and upper edge. Smaller panoramas are enlarged by whole factors before.
    """
    height, width, _ = pixels.shape
    if height < rows or width < 2 * rows:
        pixels = pixels.repeat(ceil(rows / height), axis=0).repeat(ceil(2 * rows / width), axis=1)
        height, width, _ = pixels.shape
    for axis, (count, parts) in enumerate(((height, rows), (width, 2 * rows))):
        starts = -(-np.arange(parts) * count // parts)  # rounded up
        sizes = np.diff([*starts, count]).reshape((-1, 1, 1) if axis == 0 else (-1, 1))
        pixels = np.add.reduceat(pixels.astype(np.float64), starts, axis) / sizes
    return pixels
