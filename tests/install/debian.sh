#!/usr/bin/env bash
# debian.sh WHAT PACKAGE...: install Debian's packages of an independent peer of the integration tests, where
# that is allowed and possible.
set -euo pipefail
what=$1
shift

missing=()
for package in "$@"; do
    dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing+=("$package")
done
[ ${#missing[@]} = 0 ] && exit 0

without() {
    printf '[setup] %s: the integration tests with real %s will be reported as skipped\n' "$1" "$what" >&2
    [ -z "${CI:-}" ]  # there they all have to run
    exit
}

if [ "$(id -u)" = 0 ]; then root=(); else root=(sudo -n); fi
command -v apt-get >/dev/null || without "no apt-get here to install $what with"
"${root[@]}" true 2>/dev/null || without "neither root nor sudo, so no $what (${missing[*]})"
echo "[setup] installing Debian's $what: ${missing[*]}"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
export DEBIAN_FRONTEND=noninteractive
if ! { "${root[@]}" apt-get update && "${root[@]}" apt-get install -y --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
    tail -n 5 "$log" >&2
    without "Debian's $what could not be installed"
fi
