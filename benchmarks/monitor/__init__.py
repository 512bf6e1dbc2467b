"""What the fleet monitor stands."""
