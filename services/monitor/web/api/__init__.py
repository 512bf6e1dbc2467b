"""The HTTP API: the page's data, for programs."""
