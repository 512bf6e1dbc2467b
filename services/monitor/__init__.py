"""The fleet monitor: the central subscriber to class lists, distances and status of all robots."""
