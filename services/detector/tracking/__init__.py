"""Objects followed from frame to frame of one camera."""
