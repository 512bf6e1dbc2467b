"""What is in view of every camera, settled from class lists that flicker. Pure: time is an argument."""
