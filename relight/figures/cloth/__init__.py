"""Cloth: its simulation, layers, crossings and fine wrinkles."""
