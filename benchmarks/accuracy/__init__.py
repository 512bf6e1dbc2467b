"""How well a model sees the simulated warehouse."""
