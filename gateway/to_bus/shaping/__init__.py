"""Between translation and the link: fewer frames, smaller, compressed, and no more than fit the uplink."""
