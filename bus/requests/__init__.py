"""Requests and replies, over Zenoh's queries."""
