"""How exactly, and how fast, distances and object clouds are measured."""
