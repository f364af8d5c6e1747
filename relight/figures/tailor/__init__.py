"""Garments and shoes: what there is, how it is cut, sewn and painted."""
