"""Presence tokens: those of a session, in lists where it has a prefix of its own, and watches of others'."""
