"""Trains the shipped model, evaluated through the detector that uses it."""
