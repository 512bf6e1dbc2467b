"""A benchmark that fails."""

import sys

sys.stderr.write("looking\n")
sys.exit("cannot go on")
