"""What others may not do: refusals, floods and what access rules cost."""
