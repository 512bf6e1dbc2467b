"""The monitor's web server: log-in, HTTP API, live data, metrics, and the pages, which nicegui makes."""
