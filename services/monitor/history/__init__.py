"""The history of the fleet: sightings as intervals, and alerts, in SQLite or PostgreSQL."""
