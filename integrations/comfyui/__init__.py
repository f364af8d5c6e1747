"""Nodes that relight people in ComfyUI. ComfyUI imports this folder and reads the two mappings."""

try:
    import relight.photos  # noqa: F401
except ImportError:
    where = "run `pip install .` with ComfyUI's Python in a clone of relight (README.md)"
    raise ImportError(f"relight is not installed, and is on no index: {where}") from None

from .nodes import NODE_CLASS_MAPPINGS, NODE_DISPLAY_NAME_MAPPINGS

__all__ = ["NODE_CLASS_MAPPINGS", "NODE_DISPLAY_NAME_MAPPINGS"]
