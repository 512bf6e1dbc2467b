"""Masks made finer: a small network looks at each object once more, closely, with the coarse mask before it."""
