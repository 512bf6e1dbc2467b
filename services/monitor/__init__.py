"""The fleet monitor: the central subscriber to class lists, distances and status of all robots.

From the bus to the operator, each part using only those above it:

- `liveness`: the definitions and thresholds of online, stale, silent, available and lost.
- `event_loop/`: yielding, blocking calls, garbage collection and cached values, for all parts.
- `inventory/`: the objects in view of every camera, debounced; which cameras become available or silent.
- `map/`: poses of robots, last places of objects, the floor plan.
- `world/`: the sites of world models: their status, objects and zones.
- `fleet`, `snapshot`: all robots, cameras and workers, now and as one consistent view.
- `history/`: intervals of all this in SQLite or PostgreSQL.
- `rules/`: conditions on cameras, robots and zones: `model` declares a kind of rule, `findings` evaluates it.
- `alerting/`: applies the rules, and delivers alerts to robots and webhooks.
- `requests/`: inventory queries, readings of robots' clocks, and pictures to save.
- `monitor`: the running monitor as `web/` sees it: `api/`, `auth/` and `pages/`. `live_views/`: streams of pages.
- `process`: starts and connects all of it.
"""
