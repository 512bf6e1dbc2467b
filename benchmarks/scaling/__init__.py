"""How detector workers share a fleet's cameras."""
