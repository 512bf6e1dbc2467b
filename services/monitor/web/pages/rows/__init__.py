"""Tables of the page: fleet state as rows, and the templates that show them. Pure."""
