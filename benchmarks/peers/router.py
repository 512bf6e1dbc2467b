"""A Zenoh router. Argument: the endpoint to listen at."""

import json
import sys

import zenoh

from benchmarks.peers.answering import answer
from bus import BusSettings
from bus.session.config import session_config

settings = BusSettings(mode="router", listen=[sys.argv[1]], shared_memory=False)
with zenoh.open(zenoh.Config.from_json5(json.dumps(session_config(settings)))):
    answer(dict)
