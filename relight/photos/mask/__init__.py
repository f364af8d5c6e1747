"""Masks: from a file, an alpha channel or a network to coverage, one map for each person."""
