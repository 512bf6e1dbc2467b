"""The world models' objects as the monitor uses them: zones, totals and what moved."""
