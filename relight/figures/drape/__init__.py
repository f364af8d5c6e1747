"""Cloth on the moving body: its simulation, and what is laid on draped cloth."""
