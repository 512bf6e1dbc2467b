"""Programs that a benchmark runs beside fleetsight, each in a process of its own."""
