"""What is in an image file, from the command line."""
