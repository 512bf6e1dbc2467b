"""The gateway's figures, see `benchmarks.gateway.__main__`."""
