"""Maps of figures: the record, its OpenEXR file, its picture, and the packed data set for training."""

from relight.core.lazy import entry_points

__getattr__, __dir__, __all__ = entry_points(__name__, __file__)
