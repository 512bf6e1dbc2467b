"""Detects the objects in an image file, from the command line."""
