"""What people look at: streams that are subscribed to for exactly as long as somebody looks."""
