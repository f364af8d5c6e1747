"""relight: the open laboratory for occlusion-aware relighting of people."""

from typing import Any

__version__ = "0.3.0.dev0"


def __getattr__(name: str) -> Any:
    """Imports `load` and `load_light` on first use (PEP 562), since importing them takes long."""
    if name == "load":
        from relight.photos.api import load

        return load
    if name == "load_light":
        from relight.lights import load_light

        return load_light
    raise AttributeError(f"module 'relight' has no attribute {name!r}")
