"""Object clouds: the points of every object that a camera's detections show, without background."""
