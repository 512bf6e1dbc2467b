"""A benchmark that finds something at once."""

import json
import sys

if "--json" not in sys.argv:
    sys.exit("asked without --json")
sys.stderr.write("nearly there\n")
print(json.dumps({"targets": {"speed": {"value": 3.0, "at_least": 2, "met": True}}, "speed": 3.0, "seeds": [1, 2]}))
