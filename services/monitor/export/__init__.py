"""`fleetsight history export`: writes the history to files for other programs."""
