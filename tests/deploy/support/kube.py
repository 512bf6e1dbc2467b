"""The chart's pods for `podman play kube` (4.3), which knows pods, settings and volumes.

It knows no StatefulSet and no Service, so each workload is one pod under its own name, which is its host name too. It
publishes each port on the host, splits a probe's arguments at spaces, and shares a volume among all pods that have one
of that name, so ports and probes are left out and volumes are renamed. It cannot mount secrets or take variables from
them, so they are written to a folder of the host as a node of Kubernetes does: under the names, with the mode and for
the group that the pod says.
"""

import copy
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from tests.deploy.support.helm import NAME
from tests.deploy.support.podman import Podman

Object = Mapping[str, Any]


def playable(objects: Iterable[Object], folder: Path = Path()) -> str:
    """Return the pods of all workloads under the names of these, with what they mount, as YAML.

    folder: where secrets are written to, those among the objects, which have `stringData`.
    """
    every = list(objects)
    secrets = {each["metadata"]["name"]: each["stringData"] for each in every if each["kind"] == "Secret"}
    return yaml.safe_dump_all(made for each in every for made in _playable(each, secrets, folder))


def _playable(each: Object, secrets: Mapping[str, Mapping[str, str]], folder: Path) -> Iterable[Object]:
    if each["kind"] == "ConfigMap":
        yield each
    if each["kind"] not in {"Deployment", "StatefulSet"}:
        return
    template = each["spec"]["template"]
    spec = copy.deepcopy(template["spec"])
    (container,) = spec["containers"]
    for name in ("ports", "startupProbe", "readinessProbe", "livenessProbe"):
        container.pop(name, None)
    _take_secrets(each["metadata"]["name"], spec, secrets, folder)
    for claim in each["spec"].get("volumeClaimTemplates", ()):
        name = f"{NAME}-{claim['metadata']['name']}"
        yield {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "metadata": {"name": name}, "spec": claim["spec"]}
        spec["volumes"].append({"name": claim["metadata"]["name"], "persistentVolumeClaim": {"claimName": name}})
    for mounted in (*spec["volumes"], *container["volumeMounts"]):
        if mounted["name"] in {"tmp", "tls"}:
            mounted["name"] = f"{each['metadata']['name']}-{mounted['name']}"
    metadata = {"name": each["metadata"]["name"], "labels": template["metadata"]["labels"]}
    yield {"apiVersion": "v1", "kind": "Pod", "metadata": metadata, "spec": spec}


def _take_secrets(name: str, spec: Object, secrets: Mapping[str, Mapping[str, str]], folder: Path) -> None:
    """Have the only container of a pod mount files and take values in place of secrets."""
    for variable in spec["containers"][0]["env"]:
        if "valueFrom" in variable:
            reference = variable.pop("valueFrom")["secretKeyRef"]
            variable["value"] = secrets[reference["name"]][reference["key"]]
    for volume in spec["volumes"]:
        if "secret" in volume:
            secret = volume.pop("secret")
            written = folder / f"{name}-{volume['name']}"
            _write(written, secret, secrets[secret["secretName"]], spec["securityContext"]["fsGroup"])
            volume["hostPath"] = {"path": str(written), "type": "Directory"}


def _write(folder: Path, volume: Object, secret: Mapping[str, str], group: int) -> None:
    """Write a secret's items for a volume."""
    folder.mkdir()
    for item in volume["items"]:
        file = folder / item["path"]
        file.write_text(secret[item["key"]], encoding="utf-8")
        os.chown(file, 0, group)
        file.chmod(volume["defaultMode"])


def pod(process: str) -> str:
    """Return the name of the only container in a pod."""
    return f"{NAME}-{process}-{process}"


def ask(podman: Podman, container: str, path: str, *headers: str) -> tuple[str, str]:
    """Return what the chart's monitor answers another pod, as Prometheus would ask it, and its status."""
    script = (
        "import sys, urllib.error, urllib.request as web\n"
        "asked = web.Request(sys.argv[1], headers=dict(each.split(': ') for each in sys.argv[2:]))\n"
        "try: answer = web.urlopen(asked, timeout=9)\n"
        "except urllib.error.HTTPError as error: answer = error\n"
        "print(answer.read().decode() + '\\n' + str(answer.status))"
    )
    url = f"http://{NAME}-monitor:8080{path}"
    body, _, status = podman.run("exec", container, "python3", "-c", script, url, *headers).strip().rpartition("\n")
    return body, status
