"""Diagnoses why no data flows: evidence is collected with deadlines and judged by pure checks.

Nothing here creates demand: no stream's key is subscribed to on the bus, and nothing is registered at the ROS master.
"""
