"""Rules that turn what the fleet sees into alerts and actions. Pure, but for what reads and sends."""
