"""A person's body, and its motion into a pose, from MakeHuman's data."""
