#!/usr/bin/env bash
# Install Debian's own nginx, a proxy with TLS. The tests start one of their own; none is left running here.
set -euo pipefail
if [ "$(id -u)" = 0 ] && ! [ -e /usr/sbin/nginx ] && ! [ -e /usr/sbin/policy-rc.d ]; then
    printf '#!/bin/sh\nexit 101\n' >/usr/sbin/policy-rc.d  # as its package would start a server on port 80
    chmod +x /usr/sbin/policy-rc.d
    trap 'rm -f /usr/sbin/policy-rc.d' EXIT
fi
"$(dirname "$0")/debian.sh" nginx nginx-light openssl
