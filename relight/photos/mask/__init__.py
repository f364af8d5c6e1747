"""Masks: from a file, an alpha channel or a network to coverage, one map for each person."""

from relight.lazy import entry_points

__getattr__, __dir__, __all__ = entry_points(__name__, __file__)
