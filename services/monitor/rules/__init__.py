"""Rules that turn the fleet's sightings into alerts and actions."""
