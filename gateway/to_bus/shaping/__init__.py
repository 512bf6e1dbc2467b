"""Shaping between translation and link: frame rate, scaling, compression and the uplink's budget."""
