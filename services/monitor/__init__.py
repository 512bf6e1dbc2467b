"""The fleet monitor: the central subscriber to what every robot sees."""
