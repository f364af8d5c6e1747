"""relight: the open laboratory for occlusion-aware relighting of people."""

from typing import Any

from relight.core.version import __version__ as __version__


def __getattr__(name: str) -> Any:
    """Imports `load`, `load_light` and `UserError` on first use (PEP 562), since importing them takes long."""
    if name == "load":
        from relight.photos.api import load

        return load
    if name == "load_light":
        from relight.lights import load_light

        return load_light
    if name == "UserError":
        from relight.core.errors import UserError

        return UserError
    raise AttributeError(f"module 'relight' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), "UserError", "load", "load_light"]
