"""Live views: streams that are subscribed to only while somebody watches them."""
