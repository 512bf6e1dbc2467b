"""`fleetsight users`: who may log in to a monitor, changed beside it, while it runs or not."""
