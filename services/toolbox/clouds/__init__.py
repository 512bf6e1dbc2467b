"""Show the clouds of a camera's objects, or save them to files."""
