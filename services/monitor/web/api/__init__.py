"""The HTTP API: what the page shows, for programs."""
