#!/usr/bin/env bash
# Install Debian's own Chromium, with the fonts that the page is drawn with.
set -euo pipefail
exec "$(dirname "$0")/debian.sh" Chromium chromium fonts-liberation
