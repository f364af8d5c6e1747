"""Panoramas: read, generated, and projected to lights."""

from relight.lazy import entry_points

__getattr__, __dir__, __all__ = entry_points(
    __name__,
    {
        "colour": "luminance",
        "panorama": "Panorama",
        "projection": "orient project",
        "read": "list_panoramas read_panorama",
        "rooms": "generate_room",
        "skies": "generate_sky",
    },
)
