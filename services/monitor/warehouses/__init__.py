"""Several warehouses under one centre: what this monitor reports to it, and what a centre knows of each."""
