"""Where what cameras see is in space: camera models, frames of reference over time, masks, depth. Pure."""
