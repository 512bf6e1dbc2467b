#!/usr/bin/env bash
# Install Debian's own Prometheus, for its promtool. None is left running here.
set -euo pipefail
if [ "$(id -u)" = 0 ] && ! [ -e /usr/bin/promtool ] && ! [ -e /usr/sbin/policy-rc.d ]; then
    printf '#!/bin/sh\nexit 101\n' >/usr/sbin/policy-rc.d  # as its package would start a server on port 9090
    chmod +x /usr/sbin/policy-rc.d
    trap 'rm -f /usr/sbin/policy-rc.d' EXIT
fi
"$(dirname "$0")/debian.sh" Prometheus prometheus
