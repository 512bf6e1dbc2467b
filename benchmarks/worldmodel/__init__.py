"""How true the world model is to a simulated warehouse."""
