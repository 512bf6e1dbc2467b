"""The objects in view of every camera, debounced from flickering class lists. Pure: time is an argument."""
