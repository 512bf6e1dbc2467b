"""Faults of processes, networks, disks, clocks and certificates in a running fleet, and what each cost."""
