"""Who may reach which port of the chart's pods, and what it refuses to open; what may be taken away from them."""

from collections.abc import Iterable, Mapping
from typing import Any

import pytest

from tests.deploy.support.helm import CHART, NAME, Values, find, helm, refusal, render

OWN = {"app.kubernetes.io/name": "fleetsight", "app.kubernetes.io/instance": "demo"}
MONITOR = {**OWN, "app.kubernetes.io/component": "monitor"}
WORKERS = ("detector", "distance", "cloud", "worldmodel")
NETWORKS = ["10.20.0.0/16", "fd00::/64"]
CERTIFICATES = {"monitor": "central", "detector": "gpu1", "space": "space1", "worldmodel": "world1", "access": "rules"}

Pod = Mapping[str, str]


def selects(selector: Mapping[str, Any], labels: Pod) -> bool:
    """Whether a selector of labels selects a pod, as Kubernetes defines it; an empty one selects all."""
    for wish in selector.get("matchExpressions", ()):
        assert wish["operator"] == "NotIn"
        if labels.get(wish["key"]) in wish["values"]:
            return False
    wanted: Pod = selector.get("matchLabels", {})
    return wanted.items() <= labels.items()


def labels_of(objects: Iterable[Mapping[str, Any]]) -> dict[str, Pod]:
    """Return the labels of each process's pods."""
    return {
        each["spec"]["template"]["metadata"]["labels"]["app.kubernetes.io/component"]: each["spec"]["template"][
            "metadata"
        ]["labels"]
        for each in objects
        if each["kind"] in {"Deployment", "StatefulSet"}
    }


def policies_of(objects: Iterable[Mapping[str, Any]], labels: Pod) -> list[Mapping[str, Any]]:
    """Return the policies that hold for a pod."""
    specs = [each["spec"] for each in objects if each["kind"] == "NetworkPolicy"]
    return [spec for spec in specs if selects(spec["podSelector"], labels)]


def test_every_pod_has_one_policy_so_that_what_none_allows_is_denied() -> None:
    objects = render()
    pods = labels_of(objects)
    assert pods.keys() == {"monitor", *WORKERS}
    for labels in pods.values():
        (policy,) = policies_of(objects, labels)
        assert "Ingress" in policy["policyTypes"]
    stranger = {**MONITOR, "app.kubernetes.io/instance": "other"}
    assert policies_of(objects, stranger) == []


@pytest.mark.parametrize("worker", WORKERS)
def test_nobody_reaches_a_worker_and_it_reaches_name_servers_and_the_router_alone(worker: str) -> None:
    objects = render()
    (policy,) = policies_of(objects, labels_of(objects)[worker])
    assert policy["policyTypes"] == ["Ingress", "Egress"]
    assert "ingress" not in policy
    names, router = policy["egress"]
    assert names == {"ports": [{"port": 53, "protocol": "UDP"}, {"port": 53, "protocol": "TCP"}]}
    assert router == {"ports": [{"port": "zenoh"}], "to": [{"podSelector": {"matchLabels": MONITOR}}]}


def test_the_release_s_own_pods_alone_reach_the_router_unless_networks_are_named() -> None:
    objects = render()
    (policy,) = policies_of(objects, labels_of(objects)["monitor"])
    router, page = policy["ingress"]
    assert router == {"ports": [{"port": "zenoh"}], "from": [{"podSelector": {"matchLabels": OWN}}]}
    assert page["ports"] == [{"port": "web"}]
    assert page["from"] == [{"namespaceSelector": {}}, {"ipBlock": {"cidr": "0.0.0.0/0"}}]

    named = render({"tls": CERTIFICATES, "networkPolicy": {"robots": NETWORKS, "page": NETWORKS[:1]}})
    (policy,) = policies_of(named, labels_of(named)["monitor"])
    router, page = policy["ingress"]
    assert router["from"][1:] == [{"ipBlock": {"cidr": each}} for each in NETWORKS]
    assert page["from"][1:] == [{"ipBlock": {"cidr": NETWORKS[0]}}]


def test_the_monitor_reaches_its_database_and_webhooks_wherever_they_are() -> None:
    objects = render({"monitor": {"history": {"secret": "database"}}})
    (policy,) = policies_of(objects, labels_of(objects)["monitor"])
    assert (policy["policyTypes"], "egress" in policy) == (["Ingress"], False)


def test_policies_are_about_ports_that_the_monitor_has() -> None:
    objects = render()
    (container,) = find(objects, "StatefulSet", "monitor")["spec"]["template"]["spec"]["containers"]
    ports = {each["name"]: each["containerPort"] for each in container["ports"]}
    assert ports == {"zenoh": 7447, "web": 8080}
    for service, port in (("monitor", "zenoh"), ("web", "web")):
        (served,) = find(objects, "Service", service)["spec"]["ports"]
        assert (served["targetPort"], served["port"]) == (port, ports[port])


OPEN: dict[str, Values] = {
    "networks": {"networkPolicy": {"robots": NETWORKS}},
    "no policy": {"networkPolicy": {"enabled": False}},
}


@pytest.mark.parametrize("name", OPEN)
def test_links_without_certificates_are_not_opened_to_others_unless_that_is_asked_for(name: str) -> None:
    assert "name certificates, or set tls.insecure if that is wanted" in refusal(OPEN[name])
    assert render({**OPEN[name], "tls": {"insecure": True}})
    assert render({**OPEN[name], "tls": CERTIFICATES})


@pytest.mark.parametrize(
    ("values", "said", "unsaid"),
    [
        ({}, "only the network policy", "tls.insecure is set"),
        ({"tls": {"insecure": True}}, "tls.insecure is set", "only the network policy"),
        ({"tls": CERTIFICATES}, "name the robots' networks in networkPolicy.robots.", "reading everything"),
        ({"tls": CERTIFICATES, "networkPolicy": {"robots": NETWORKS}}, "tls/demo-fleetsight-monitor:7447", "Only this"),
    ],
)
def test_its_notes_say_who_may_connect(values: Values, said: str, unsaid: str) -> None:
    notes = helm("install", "demo", CHART, "--dry-run=client", values=values).stdout.partition("NOTES:")[2]
    assert said in notes
    assert unsaid not in notes


def budgets(values: Values) -> dict[str, Any]:
    """Return the disruption budgets by process."""
    found = [each for each in render(values) if each["kind"] == "PodDisruptionBudget"]
    return {each["metadata"]["name"].removeprefix(f"{NAME}-"): each["spec"] for each in found}


def test_several_workers_of_a_kind_are_not_all_taken_away_at_once() -> None:
    many = budgets({"detector": {"replicas": 3}, "distance": {"replicas": 2}})
    assert many.keys() == {"detector", "distance"}
    for name, budget in many.items():
        labels = {**OWN, "app.kubernetes.io/component": name}
        assert budget == {"maxUnavailable": 1, "selector": {"matchLabels": labels}}
    assert budgets({"detector": {"autoscaling": {"enabled": True}}}).keys() == {"detector"}


def test_one_pod_has_no_budget_which_would_block_its_node_or_say_nothing() -> None:
    assert budgets({}) == {}
    assert budgets({"detector": {"replicas": 5, "autoscaling": {"enabled": True, "maxReplicas": 1}}}) == {}


def test_prometheus_gets_the_token_of_a_secret() -> None:
    objects = render({"serviceMonitor": {"enabled": True, "tokenSecret": "scraping", "interval": "5s"}})
    (asked,) = find(objects, "ServiceMonitor", "monitor")["spec"]["endpoints"]
    assert asked == {
        "port": "web",
        "path": "/metrics",
        "interval": "5s",
        "authorization": {"credentials": {"name": "scraping", "key": "token"}},
    }
    assert "web_open_metrics: false" in find(objects, "ConfigMap", "monitor")["data"]["settings.yaml"]
    (other,) = find(
        render({"serviceMonitor": {"enabled": True}, "monitor": {"openMetrics": True}}), "ServiceMonitor", "monitor"
    )["spec"]["endpoints"]
    assert "authorization" not in other


@pytest.mark.parametrize(("kind", "policy"), [("ClusterIP", None), ("NodePort", "Local"), ("LoadBalancer", "Local")])
def test_a_service_for_robots_keeps_their_addresses_by_which_the_policy_lets_them_in(
    kind: str, policy: str | None
) -> None:
    services = (each["spec"] for each in render({"monitor": {"robots": {"type": kind}}}) if each["kind"] == "Service")
    (found,) = (each for each in services if each.get("type") == kind and each["ports"][0]["port"] == 7447)
    assert found.get("externalTrafficPolicy") == policy
