"""Computes a model's metrics, with the same code for the model card and the benchmark."""
