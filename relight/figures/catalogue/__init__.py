"""Catalogues of all that a figure is drawn from: YAML files, which `schema` reads."""
