"""How well a model sees photographs."""
