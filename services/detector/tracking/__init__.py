"""Follows objects from frame to frame of one camera."""
