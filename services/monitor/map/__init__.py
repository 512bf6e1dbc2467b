"""Poses of robots and last places of objects, in the frame `map`."""
