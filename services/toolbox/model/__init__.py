"""Publishes models, puts them in force, and lists them, from the command line."""
