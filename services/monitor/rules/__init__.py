"""Rules that turn what the fleet sees into alerts and actions."""
