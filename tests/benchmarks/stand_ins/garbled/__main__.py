"""A benchmark that prints no JSON object."""

print("[1]")
