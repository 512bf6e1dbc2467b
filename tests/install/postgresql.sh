#!/usr/bin/env bash
# Install Debian's own PostgreSQL server. The tests start one of their own; none is left running here.
set -euo pipefail
if [ "$(id -u)" = 0 ] && ! [ -e /etc/postgresql-common/createcluster.conf ]; then
    mkdir -p /etc/postgresql-common
    echo "create_main_cluster = false" >/etc/postgresql-common/createcluster.conf
fi
exec "$(dirname "$0")/debian.sh" PostgreSQL postgresql
