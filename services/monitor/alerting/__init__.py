"""Alerting: applies rules to the fleet and delivers alerts to robots, webhooks and the history."""
