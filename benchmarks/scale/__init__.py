"""Bytes, time and memory of a large fleet on one router."""
