"""Alerts on their way: rules applied to what is seen, and told to robots, webhooks and the store."""
