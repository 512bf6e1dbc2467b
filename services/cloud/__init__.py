"""Cuts object clouds: the points of every detected object, without background."""
