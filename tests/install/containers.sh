#!/usr/bin/env bash
# Install Debian's tools that make and start whole systems: mmdebstrap, systemd-nspawn, podman. Nothing is left running.
set -euo pipefail
"$(dirname "$0")/debian.sh" "containers" \
    mmdebstrap systemd-container podman netavark aardvark-dns iptables buildah runc catatonit uidmap
