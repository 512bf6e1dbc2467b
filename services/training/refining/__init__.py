"""Trains the refiner of masks on objects that the model finds in scenes of their own."""
