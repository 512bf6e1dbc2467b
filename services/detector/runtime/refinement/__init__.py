"""Refines masks: a small network processes a close-up of each object together with its coarse mask."""
