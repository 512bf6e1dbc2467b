"""The whole system on one machine, on simulated robots: what `make demo` runs."""
