"""Poses, the motion into them, and props."""
