"""What is cut for a body before it moves: patterns of garments, and shoes."""
