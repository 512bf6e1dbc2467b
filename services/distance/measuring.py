"""What depth says of the objects of one image. Pure."""
