"""The Helm chart: what real Helm and Kubernetes' own schemas say of it, and what it refuses."""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from services.toolbox.settings import load
from tests.deploy.support.helm import CHART, NAME, Values, find, helm, refusal, render
from tests.deploy.support.units import DEPLOY, command
from tests.missing import require_debian

KUBERNETES = ("1.29", "1.35", "1.36", "1.37")
"""The oldest that the chart allows, and the last three."""

CUSTOM = {"ScaledObject", "ServiceMonitor", "PrometheusRule"}
"""Kinds that are not Kubernetes' own."""

CUSTOM_KINDS = Path(sys.executable).parents[1] / "custom-kinds"

CERTIFICATES = {"monitor": "central", "detector": "gpu1", "space": "space1", "worldmodel": "world1", "access": "rules"}
ENDS = (".pem", ".key")
SETS: dict[str, Values] = {
    "defaults": {},
    "GPU": {
        "detector": {
            "gpus": 2,
            "models": "weights",
            "settings": {"model": "/models/my-seg.pt"},
            "nodeSelector": {"gpu": "yes"},
            "tolerations": [{"key": "nvidia.com/gpu", "operator": "Exists"}],
        }
    },
    "PostgreSQL": {
        "monitor": {"history": {"secret": "database"}, "files": "site", "settings": {"rules": "rules.yaml"}}
    },
    "certificates": {"tls": CERTIFICATES, "monitor": {"robots": {"type": "NodePort", "nodePort": 30447}}},
    "autoscaling": {
        **{name: {"autoscaling": {"enabled": True}} for name in ("detector", "distance", "cloud")},
        "monitor": {"openMetrics": True},
        "serviceMonitor": {"enabled": True, "labels": {"release": "prometheus"}},
        "prometheusRule": {"enabled": True},
        "image": {"pullSecrets": ["registry"]},
    },
    "monitor alone": {name: {"enabled": False} for name in ("detector", "distance", "cloud", "worldmodel")},
}


@pytest.fixture(scope="module")
def rendered() -> dict[str, list[dict[str, Any]]]:
    return {name: render(values) for name, values in SETS.items()}


def test_helm_has_nothing_to_say_against_it() -> None:
    done = helm("lint", "--strict", CHART)
    assert done.returncode == 0, done.stdout
    assert re.findall(r"\[(?:WARNING|ERROR)\].*", done.stdout) == []


@pytest.mark.parametrize("version", KUBERNETES)
def test_kubernetes_takes_it(rendered: dict[str, list[dict[str, Any]]], version: str) -> None:
    different = {yaml.safe_dump(each): each for objects in rendered.values() for each in objects}
    for each in different.values():
        if each["kind"] not in CUSTOM:
            try:
                kubernetes_validate.validate(each, version, strict=True)
            except kubernetes_validate.ValidationError as error:
                pytest.fail(f"{each['kind']} {each['metadata']['name']}: {list(error.path)} {error.message}")


def test_kubernetes_would_refuse_a_misspelt_field(rendered: dict[str, list[dict[str, Any]]]) -> None:
    deployment = json.loads(json.dumps(find(rendered["defaults"], "Deployment", "detector")))
    deployment["spec"]["template"]["spec"]["containers"][0]["livenesProbe"] = {}
    with pytest.raises(kubernetes_validate.ValidationError, match="livenesProbe"):
        kubernetes_validate.validate(deployment, KUBERNETES[-1], strict=True)


def custom_reasons(objects: list[dict[str, Any]]) -> list[str]:
    """Return what is wrong with objects of other kinds than Kubernetes' own, by their published schemas."""
    require_debian("their schemas", [CUSTOM_KINDS / "node_modules"], how="tests/install/custom_kinds.sh installs them")
    command = ["node", str(Path(__file__).parent / "support" / "custom_kinds.js"), str(CUSTOM_KINDS)]
    done = subprocess.run(command, input=json.dumps(objects), capture_output=True, text=True, check=True)
    return list(json.loads(done.stdout))


def test_keda_and_the_prometheus_operator_take_their_kinds(rendered: dict[str, list[dict[str, Any]]]) -> None:
    objects = [each for each in rendered["autoscaling"] if each["kind"] in CUSTOM]
    assert {each["kind"] for each in objects} == CUSTOM
    assert custom_reasons(objects) == [""] * len(objects)


def test_keda_would_refuse_a_wrong_number(rendered: dict[str, list[dict[str, Any]]]) -> None:
    scaled = json.loads(json.dumps(find(rendered["autoscaling"], "ScaledObject", "cloud")))
    scaled["spec"]["minReplicaCount"] = "one"
    assert custom_reasons([scaled]) == ["data/spec/minReplicaCount must be integer"]


def pods(objects: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    for each in objects:
        if each["kind"] in {"Deployment", "StatefulSet"}:
            yield each["spec"]["template"]["spec"]


def test_no_pod_has_rights_or_unbounded_memory(rendered: dict[str, list[dict[str, Any]]]) -> None:
    found = [pod for objects in rendered.values() for pod in pods(objects)]
    assert len(found) == 5 * (len(SETS) - 1) + 1
    for pod in found:
        assert (pod["securityContext"]["runAsNonRoot"], pod["automountServiceAccountToken"]) == (True, False)
        (container,) = pod["containers"]
        confined = {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert container["securityContext"] == confined
        assert container["resources"]["limits"]["memory"]
        assert container["resources"]["requests"].keys() == {"cpu", "memory"}
        assert {"livenessProbe", "readinessProbe"} <= container.keys()


def settings_of(objects: list[dict[str, Any]]) -> dict[str, str]:
    return {
        each["metadata"]["name"].removeprefix(f"{NAME}-"): each["data"]["settings.yaml"]
        for each in objects
        if each["kind"] == "ConfigMap"
    }


@pytest.mark.parametrize("name", ["defaults", "autoscaling", "monitor alone", "certificates"])
def test_its_settings_are_those_of_the_commands(
    rendered: dict[str, list[dict[str, Any]]], name: str, tmp_path: Path
) -> None:
    file = tmp_path / "settings.yaml"
    mounted = [
        "access/access.json",
        "tls/ca.pem",
        *(f"tls/{each}{end}" for each in CERTIFICATES.values() for end in ENDS),
    ]
    for each in mounted:
        (tmp_path / each).parent.mkdir(exist_ok=True)
        (tmp_path / each).touch()
    for process, text in settings_of(rendered[name]).items():
        file.write_text(text.replace("/etc/fleetsight", str(tmp_path)), encoding="utf-8")
        load(command(process).load_settings(), ["--config", str(file)], prog="fleetsight")


def test_images_are_targets_of_the_container_file(rendered: dict[str, list[dict[str, Any]]]) -> None:
    images = {pod["containers"][0]["image"] for objects in rendered.values() for pod in pods(objects)}
    version = tomllib.loads((DEPLOY.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    targets = re.findall(
        r"^FROM \S+ AS ([a-z-]+)$", (DEPLOY / "Containerfile").read_text(encoding="utf-8"), re.MULTILINE
    )
    for image in images:
        assert (match := re.fullmatch(rf"localhost/fleetsight-([a-z-]+):{re.escape(version)}", image)), image
        assert match[1] in targets
    assert len(images) == 4
    assert yaml.safe_load((CHART / "Chart.yaml").read_text(encoding="utf-8"))["version"] == version


def test_a_detector_gets_its_gpus_and_weights(rendered: dict[str, list[dict[str, Any]]]) -> None:
    pod = find(rendered["GPU"], "Deployment", "detector")["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    assert container["resources"]["limits"] == {"memory": "4Gi", "nvidia.com/gpu": 2}
    assert "/fleetsight-detector:" in container["image"]
    assert pod["nodeSelector"] == {"gpu": "yes"}
    assert pod["tolerations"] == [{"key": "nvidia.com/gpu", "operator": "Exists"}]
    (plain,) = find(rendered["defaults"], "Deployment", "detector")["spec"]["template"]["spec"]["containers"]
    assert (plain["resources"]["limits"].keys(), "/fleetsight-detector-cpu:" in plain["image"]) == ({"memory"}, True)
    assert {"name": "models", "persistentVolumeClaim": {"claimName": "weights", "readOnly": True}} in pod["volumes"]
    assert yaml.safe_load(settings_of(rendered["GPU"])["detector"])["model"] == "/models/my-seg.pt"


def test_a_history_in_postgresql_needs_no_volume(rendered: dict[str, list[dict[str, Any]]]) -> None:
    kept = find(rendered["defaults"], "StatefulSet", "monitor")["spec"]
    assert [each["metadata"]["name"] for each in kept["volumeClaimTemplates"]] == ["history"]
    shared = find(rendered["PostgreSQL"], "StatefulSet", "monitor")["spec"]
    assert "volumeClaimTemplates" not in shared
    url = {"name": "FLEETSIGHT_HISTORY", "valueFrom": {"secretKeyRef": {"name": "database", "key": "url"}}}
    assert url in shared["template"]["spec"]["containers"][0]["env"]


def test_with_certificates_every_link_has_one(rendered: dict[str, list[dict[str, Any]]]) -> None:
    settings = {name: yaml.safe_load(text) for name, text in settings_of(rendered["certificates"]).items()}
    assert settings["monitor"]["listen"] == ["tls/0.0.0.0:7447"]
    assert settings["monitor"]["access"] == "/etc/fleetsight/access/access.json"
    assert "insecure" not in settings["monitor"]
    assert {name: each["tls"].rpartition("/")[2] for name, each in settings.items()} == {
        **{name: name_of for name, name_of in CERTIFICATES.items() if name in settings},
        "distance": "space1",
        "cloud": "space1",
    }
    for name in settings.keys() - {"monitor"}:
        assert settings[name]["connect"] == [f"tls/{NAME}-monitor:7447"]
    for pod in pods(rendered["certificates"]):
        (secret,) = (each["secret"] for each in pod["volumes"] if "secret" in each)
        assert secret["defaultMode"] == 0o440  # a process ends if everybody may read its key
        assert {each["path"] for each in secret["items"]} == {
            "ca.pem",
            f"{secret['secretName']}.pem",
            f"{secret['secretName']}.key",
        }


def test_a_number_of_workers_is_set_by_the_chart_or_by_the_scaler(rendered: dict[str, list[dict[str, Any]]]) -> None:
    for name in ("detector", "distance", "cloud"):
        assert find(rendered["defaults"], "Deployment", name)["spec"]["replicas"] == 1
        assert "replicas" not in find(rendered["autoscaling"], "Deployment", name)["spec"]
        scaled = find(rendered["autoscaling"], "ScaledObject", name)["spec"]
        assert scaled["scaleTargetRef"] == {"name": f"{NAME}-{name}"}


def test_values_that_were_kept_from_before_these_workers_were_scaled_do() -> None:
    kept: Values = {name: {"autoscaling": None} for name in ("distance", "cloud")}
    assert not [each for each in render(kept) if each["kind"] == "ScaledObject"]


def test_every_selector_finds_pods(rendered: dict[str, list[dict[str, Any]]]) -> None:
    for objects in rendered.values():
        templates = [each["spec"]["template"] for each in objects if each["kind"] in {"Deployment", "StatefulSet"}]
        labels = [template["metadata"]["labels"].items() for template in templates]
        for each in objects:
            selector = each["spec"].get("selector") or each["spec"].get("podSelector") if "spec" in each else None
            if selector and each["kind"] != "ServiceMonitor":
                wanted = selector if each["kind"] == "Service" else selector["matchLabels"]
                assert any(wanted.items() <= found for found in labels), each


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"detector": {"replicas": "many"}}, "at '/detector/replicas': got string, want integer"),
        ({"detectors": {"replicas": 2}}, "additional properties 'detectors' not allowed"),
        ({"detector": {"gpu": 1}}, "at '/detector': additional properties 'gpu' not allowed"),
        ({"detector": {"autoscaling": {"minReplicas": 0}}}, "minReplicas': minimum: got 0, want 1"),
        ({"detector": {"autoscaling": {"targetLoad": 70}}}, "targetLoad': maximum: got 70, want 1"),
        ({"monitor": {"history": {"size": 10}}}, "at '/monitor/history/size': got number, want string"),
        ({"monitor": {"robots": {"type": "Loadbalancer"}}}, "at '/monitor/robots/type': value must be one of"),
        (
            {"networkPolicy": {"robots": ["10.0.0.1"]}},
            "at '/networkPolicy/robots/0': '10.0.0.1' does not match pattern",
        ),
        ({"tls": {"monitor": "central"}}, "with tls.monitor set, name the certificate and secret of"),
        ({"tls": {**CERTIFICATES, "access": ""}}, "tls.access: name the ConfigMap with access.json"),
        ({"serviceMonitor": {"enabled": True}}, "/metrics wants a token; name its secret (serviceMonitor.tokenSecret)"),
        (
            {"detector": {"autoscaling": {"enabled": True, "minReplicas": 9}}},
            "detector.autoscaling: minReplicas is more than maxReplicas",
        ),
        ({"cloud": {"autoscaling": {"prometheus": "http://p"}}}, "additional properties 'prometheus' not allowed"),
    ],
)
def test_wrong_values_are_refused_by_name(values: Values, said: str) -> None:
    assert said in refusal(values)


def test_every_value_has_a_schema() -> None:
    schema = json.loads((CHART / "values.schema.json").read_text(encoding="utf-8"))

    def check(value: object, known: dict[str, Any], path: str) -> None:
        if isinstance(value, dict) and "properties" in known:
            assert value.keys() == known["properties"].keys() - {"global"}, path
            for name, inner in value.items():
                check(inner, known["properties"][name], f"{path}.{name}")

    check(yaml.safe_load((CHART / "values.yaml").read_text(encoding="utf-8")), schema, "")


def test_no_template_is_long() -> None:
    templates = list((CHART / "templates").iterdir())
    assert len(templates) <= 12
    assert all(len(each.read_text(encoding="utf-8").splitlines()) < 150 for each in templates)


def test_a_monitor_with_a_certificate_for_its_page_is_looked_at_over_https() -> None:
    settings = {"web_certificate": "/etc/fleetsight/files/page.pem", "web_key": "/etc/fleetsight/files/page.key"}
    for given, scheme in (({}, "HTTP"), (settings, "HTTPS")):
        objects = render({"monitor": {"settings": given}})
        (container,) = find(objects, "StatefulSet", "monitor")["spec"]["template"]["spec"]["containers"]
        probes = [container[each]["httpGet"]["scheme"] for each in ("startupProbe", "livenessProbe")]
        assert probes == [scheme] * 2
    assert "web_port" in refusal({"monitor": {"settings": {"web_port": 9000}}})


def test_rules_are_about_the_series_of_this_release_alone() -> None:
    autoscaling = {"enabled": True, "matchers": 'namespace="north"'}
    objects = render({"detector": {"autoscaling": autoscaling}, "prometheusRule": {"enabled": True}})
    rules = next(each for each in objects if each["kind"] == "PrometheusRule")
    expressions = [rule["expr"] for group in rules["spec"]["groups"] for rule in group["rules"]]
    series = [found for each in expressions for found in re.findall(r"fleetsight_\w+\{[^}]*", each)]
    assert len(series) > len(expressions)
    assert all('{namespace="north"' in each for each in series)
