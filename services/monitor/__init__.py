"""The fleet monitor: the central subscriber to class lists, distances and status of all robots.

From the bus to the operator, each part using only those above it:

- `liveness`: the definitions and thresholds of online, stale, silent, available and lost.
- `inventory/`: the objects in view of every camera, debounced; who becomes available or silent.
- `map/`: poses of robots, last places of objects, the floor plan. Zones, which are areas of the map, belong here.
- `fleet`, `snapshot`: all robots, cameras and workers, now and as one consistent view.
- `history/`: intervals of all this in SQLite or PostgreSQL.
- `rules/`: conditions on cameras, robots and, later, zones: `model` declares a kind of rule, `findings` evaluates it.
- `alerting/`: applies the rules, and delivers alerts to robots and webhooks.
- `monitor`: the running monitor as `web/` sees it: `api/`, `auth/` and `pages/`. `live_views/`: streams of pages.
- `process`: starts and connects all of it.
"""
