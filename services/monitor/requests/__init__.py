"""Requests on the bus that the monitor answers, and those that it makes."""
