"""The first weights: a data set from the simulated warehouse, a training run, a model card."""
