"""Albedo and gloss: fabrics, prints, seams and wear, skin and eyes."""
