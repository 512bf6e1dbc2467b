#!/usr/bin/env bash
# Put what knows KEDA's and the Prometheus operator's kinds into a folder: packages of npm's registry with their schemas.
set -euo pipefail
folder=$1
[ -d "$folder/node_modules/@kubernetes-models/keda" ] && exit 0
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! npm install --prefix "$folder" --no-save --no-audit --no-fund --ignore-scripts --loglevel=error \
    @kubernetes-models/keda@0.4.2 @kubernetes-models/prometheus-operator@6.0.0 >"$log" 2>&1; then
    tail -n 5 "$log" >&2
    printf '[setup] no schemas of KEDA: the tests of its kinds will be reported as skipped\n' >&2
    [ -z "${CI:-}" ]  # there they all have to run
    exit
fi
echo "[setup] schemas of KEDA's and the Prometheus operator's kinds are in $folder"
