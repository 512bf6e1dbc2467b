"""The monitor's web server: log-in, HTTP API, live data, metrics; the page itself is services.monitor.web.pages."""
