"""relight: the open laboratory for occlusion-aware relighting of people."""

from typing import Any

__version__ = "0.3.0.dev0"


def __getattr__(name: str) -> Any:
    if name == "load":  # imports torch on first use, not with the package
        from relight.photos.api import load

        return load
    if name == "load_light":
        from relight.lights import load_light

        return load_light
    raise AttributeError(f"module 'relight' has no attribute {name!r}")
