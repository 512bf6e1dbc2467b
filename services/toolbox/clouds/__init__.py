"""Shows the clouds of a camera's objects, or saves them to files."""
