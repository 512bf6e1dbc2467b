"""Runs benchmarks one after another and keeps what they find."""
