#!/usr/bin/env bash
# Make .venv in the checkout, or reuse it, and install fleetsight with the extra named by the argument, if there is one.
set -euo pipefail
cd "$(dirname "$0")/.."
extra=${1:-}
log=$(mktemp)
trap 'rm -f "$log"' EXIT

say() { printf '[setup] %s\n' "$*"; }
fail() { printf '[setup] %s\n' "$*" >&2; exit 1; }
as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi; }

find_python() {
    local name
    for name in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
        if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$name"
            return
        fi
    done
    fail "no Python 3.11 or newer found; install one, or name it: make PYTHON=/path/to/python3 ..."
}

columns() { stty size </dev/tty 2>/dev/null | cut -d ' ' -f 2 | grep '[1-9]' || echo 80; }

# Run a slow command and keep one line on the screen that says how it gets on. Its output is in $log.
with_progress() {
    local what=$1 began=$SECONDS every=15 pid
    shift
    trap 'kill ${!-} 2>/dev/null; wait ${!-} || true; exit 130' INT TERM
    "$@" >"$log" 2>&1 &
    pid=$!
    [ -t 1 ] && every=1
    while kill -0 "$pid" 2>/dev/null; do
        sleep 1
        if (((SECONDS - began) % every == 0)); then
            local line="[setup] $what: $((SECONDS - began)) s, $(tail -n 1 "$log")"
            if [ -t 1 ]; then printf '\r\033[K%s' "${line:0:$(columns) - 1}"; else printf '%.120s\n' "$line"; fi
        fi
    done
    trap - INT TERM
    [ -t 1 ] && printf '\r\033[K'
    wait "$pid" || return
    say "$what: done in $((SECONDS - began)) s"
}

make_venv() {
    rm -rf .venv
    trap 'rm -rf .venv; exit 130' INT TERM # half of one would be taken for a whole one
    if ! "$1" -m venv .venv >"$log" 2>&1; then
        rm -rf .venv
        return 1
    fi
    trap - INT TERM
}

install_venv_package() {
    as_root apt-get update && as_root apt-get install -y --no-install-recommends "$1"
}

if ! [ -x .venv/bin/python ]; then
    python=$(find_python)
    say "making .venv with $("$python" --version)"
    if ! make_venv "$python"; then
        # Debian and Ubuntu keep a part of Python's venv in a package of its own, and say so.
        grep -q ensurepip "$log" || { tail -n 20 "$log" >&2; fail "could not make .venv"; }
        package=$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
        export DEBIAN_FRONTEND=noninteractive
        with_progress "installing $package" install_venv_package "$package" ||
            { tail -n 5 "$log" >&2; fail "could not install it; run as root: apt-get install $package"; }
        make_venv "$python" || { tail -n 20 "$log" >&2; fail "could not make .venv"; }
    fi
fi
[ -n "$extra" ] || exit 0
# pip that is interrupted leaves what it has fetched, and /tmp may be too small for it.
scratch=$(mktemp -d "$PWD/.venv/setup.XXXXXX")
trap 'rm -rf "$log" "$scratch"' EXIT
# Relative, because pip takes what follows a space for another file.
export PIP_CONSTRAINT=constraints.txt PIP_DISABLE_PIP_VERSION_CHECK=1 TMPDIR=$scratch
case $extra in
demo | dist) size="under 1 GB" ;;
*) size="PyTorch alone is some GB" ;;
esac
# Compiled is what is used, when it is: of PyTorch and what it brings, a small part.
if ! with_progress "installing fleetsight[$extra] ($size)" \
    .venv/bin/python -m pip install --progress-bar off --no-compile --editable ".[$extra]"; then
    tail -n 20 "$log" >&2
    fail "could not install fleetsight[$extra]"
fi
touch ".venv/.$extra"
