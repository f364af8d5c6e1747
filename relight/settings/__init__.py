"""Settings: their schema, composition from conf/, and checks."""

from relight.core.lazy import entry_points

__getattr__, __dir__, __all__ = entry_points(__name__, __file__)
