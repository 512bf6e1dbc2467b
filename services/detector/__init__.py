"""Inference workers: camera frames in, detections and class lists out."""
