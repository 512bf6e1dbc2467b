"""Geometry of what cameras see: camera models, frames of reference over time, masks, depth. Pure."""
