"""Measures the distance and position of detected objects: detections joined with depth by time and geometry."""
