"""Trains the shipped weights: data set from simulated warehouses, training run, model card."""
