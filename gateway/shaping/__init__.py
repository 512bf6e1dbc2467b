"""What becomes of frames between translation and the link: fewer, smaller, compressed, and no more than fit the uplink."""
