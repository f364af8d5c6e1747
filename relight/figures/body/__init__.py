"""Bodies of people from MakeHuman's data, and the albedo of their skin."""
