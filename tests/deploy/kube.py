"""The chart's pods for `podman play kube` (4.3), which knows pods, settings and volumes.

It knows no StatefulSet and no Service, so each workload is one pod under its own name, which is its host name too. It
publishes each port on the host, splits a probe's arguments at spaces, and shares a volume among all pods that have one
of that name, so ports and probes are left out and volumes are renamed.
"""

import copy
from collections.abc import Iterable, Mapping
from typing import Any

import yaml

from tests.deploy.helm import NAME

Object = Mapping[str, Any]


def playable(objects: Iterable[Object]) -> str:
    """Return the pods of all workloads under the names of these, with what they mount, as YAML."""
    return yaml.safe_dump_all(made for each in objects for made in _playable(each))


def _playable(each: Object) -> Iterable[Object]:
    if each["kind"] in {"ConfigMap", "Secret"}:
        yield each
    if each["kind"] not in {"Deployment", "StatefulSet"}:
        return
    template = each["spec"]["template"]
    spec = copy.deepcopy(template["spec"])
    (container,) = spec["containers"]
    for name in ("ports", "startupProbe", "readinessProbe", "livenessProbe"):
        container.pop(name, None)
    for claim in each["spec"].get("volumeClaimTemplates", ()):
        name = f"{NAME}-{claim['metadata']['name']}"
        yield {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "metadata": {"name": name}, "spec": claim["spec"]}
        spec["volumes"].append({"name": claim["metadata"]["name"], "persistentVolumeClaim": {"claimName": name}})
    for mounted in (*spec["volumes"], *container["volumeMounts"]):
        if mounted["name"] == "tmp":
            mounted["name"] = f"{each['metadata']['name']}-tmp"
    metadata = {"name": each["metadata"]["name"], "labels": template["metadata"]["labels"]}
    yield {"apiVersion": "v1", "kind": "Pod", "metadata": metadata, "spec": spec}
