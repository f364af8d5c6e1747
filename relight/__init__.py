"""relight: the open laboratory for occlusion-aware relighting of people."""

__version__ = "0.2.0"


def __getattr__(name: str):
    if name == "load":  # torch comes in when it is called, not with the package
        from relight.photos.api import load

        return load
    raise AttributeError(f"module 'relight' has no attribute {name!r}")
