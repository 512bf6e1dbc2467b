"""Pictures of what benchmarks found, each from one kept JSON file alone."""
