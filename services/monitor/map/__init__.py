"""Where robots are and where things were seen last, in the frame `map`."""
