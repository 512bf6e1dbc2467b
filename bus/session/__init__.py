"""The Zenoh session: its thread, its configuration, its links and their certificates."""
