"""Hair of head and face, and hats."""
