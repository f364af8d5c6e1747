"""Tests that a figure must pass, or it is drawn again."""
