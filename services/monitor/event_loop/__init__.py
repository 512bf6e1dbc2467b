"""Keeps the event loop responsive."""
