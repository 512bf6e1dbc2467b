"""Runs the whole system on one machine with simulated robots: `make demo`."""
