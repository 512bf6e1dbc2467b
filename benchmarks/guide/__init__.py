"""The guide's pipeline and fleetsight, side by side on the same robot, see `benchmarks.guide.__main__`."""
