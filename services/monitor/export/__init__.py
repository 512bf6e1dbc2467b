"""`fleetsight history export`: what was kept, as files for other programs."""
