"""What the fleet saw: sightings as intervals and alerts, in SQLite or PostgreSQL."""
