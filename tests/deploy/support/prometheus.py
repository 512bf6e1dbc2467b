"""PromQL, evaluated by Prometheus' own promtool, and Kubernetes' rule for how many pods follow from a metric."""

import math
import re
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import yaml
from prometheus_client.parser import text_string_to_metric_families

from tests.missing import require_debian

PROMTOOL: Final = Path("/usr/bin/promtool")
SCRAPE_S: Final = 15
KEPT: Final = 12
"""Scrapes that are handed to promtool: more than any rule here looks back."""


def require_promtool() -> None:
    """Skip the test where there is no promtool."""
    require_debian("Prometheus", [PROMTOOL], how="tests/install/prometheus.sh installs it")


def check_rules(file: Path) -> str:
    """Return what promtool says of a file of rules; fail if it refuses it."""
    require_promtool()
    done = subprocess.run([PROMTOOL, "check", "rules", file], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def rules_of(file: Path, kind: str) -> list[str]:
    """Return the names of a file's rules. kind: `alert` or `record`."""
    groups = yaml.safe_load(file.read_text(encoding="utf-8"))["groups"]
    return [rule[kind] for group in groups for rule in group["rules"] if kind in rule]


def _tested(file: Path, tests: Mapping[str, Any]) -> str:
    """Write tests of rules to a file; return what promtool says of them."""
    file.write_text(yaml.safe_dump(dict(tests), width=1_000_000), encoding="utf-8")
    said = subprocess.run([PROMTOOL, "test", "rules", file], capture_output=True, text=True, check=False)
    return said.stdout + said.stderr


def raised(rules: Path, series: Sequence[Mapping[str, str]], folder: Path) -> dict[str, list[dict[str, str]]]:
    """Return the labels of what each alert of a file has raised after half an hour of series, a value each minute."""
    require_promtool()
    names = rules_of(rules, "alert")
    expected = [{"alertname": name, "eval_time": "30m", "exp_alerts": [{"exp_labels": {"no": name}}]} for name in names]
    test = {"interval": "1m", "input_series": list(series), "alert_rule_test": expected}
    file = folder / "alerts.yaml"
    text = _tested(file, {"rule_files": [str(rules)], "tests": [test]})
    got = r"alertname: (\w+), time: .*?got:\[(.*?)\n? *\]$"
    found = dict(re.findall(got, text, re.MULTILINE | re.DOTALL))
    assert found.keys() == set(names), text
    labels = {name: re.findall(r"Labels:\{([^}]*)\}", got) for name, got in found.items()}
    return {
        name: [
            {key: value for key, value in re.findall(r'(\w+)="([^"]*)"', each) if key != "alertname"} for each in texts
        ]
        for name, texts in labels.items()
    }


class Series:
    """What a Prometheus has scraped, every SCRAPE_S."""

    def __init__(self, folder: Path) -> None:
        require_promtool()
        self._file = folder / "series.yaml"
        self._scrapes: list[dict[str, float]] = []

    def scrape(self, text: str, labels: str = "") -> None:
        """Take what a monitor's /metrics says. labels: more of them, as a scrape job adds."""
        self._scrapes.append({})
        self.add(text, labels)

    def add(self, text: str, labels: str = "") -> None:
        """Take another monitor's text in the same scrape."""
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                own = [f"{name}={_quoted(value)}" for name, value in sample.labels.items()]
                self._scrapes[-1][f"{sample.name}{{{','.join(filter(None, [*own, labels]))}}}"] = sample.value

    def value(self, expression: str) -> float | None:
        """Return what an expression comes to now; None for no sample."""
        scrapes = self._scrapes[-KEPT:]
        names = sorted({name for scrape in scrapes for name in scrape})
        series = [
            {"series": name, "values": " ".join(str(scrape.get(name, "_")) for scrape in scrapes)} for name in names
        ]
        at = f"{(len(scrapes) - 1) * SCRAPE_S}s"
        impossible = {"expr": expression, "eval_time": at, "exp_samples": [{"labels": "none", "value": 0}]}
        test = {"interval": f"{SCRAPE_S}s", "input_series": series, "promql_expr_test": [impossible]}
        text = _tested(self._file, {"evaluation_interval": f"{SCRAPE_S}s", "tests": [test]})
        got = re.search(r"^ *got: *(.*)$", text, re.MULTILINE)
        assert got, text
        return None if got[1] == "nil" else float(got[1].rpartition(" ")[2])


def _quoted(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


class Scaler:
    """Decides the number of pods as Kubernetes' HorizontalPodAutoscaler does, on a metric with a target per pod.

    scaled: the spec of KEDA's ScaledObject. Its windows and policies are those of `behavior`.
    """

    TOLERANCE: Final = 0.1

    def __init__(self, scaled: Mapping[str, Any]) -> None:
        (trigger,) = scaled["triggers"]
        self._target = float(trigger["metadata"]["threshold"])
        self._least, self._most = scaled["minReplicaCount"], scaled["maxReplicaCount"]
        behavior = scaled["advanced"]["horizontalPodAutoscalerConfig"]["behavior"]
        self._up, self._down = behavior["scaleUp"], behavior["scaleDown"]
        self._proposed: list[tuple[float, int]] = []
        self._replicas: list[tuple[float, int]] = []

    def decide(self, load: float | None, replicas: int, now_s: float) -> int:
        """Return the number of pods that there are to be; load: None keeps them."""
        self._replicas.append((now_s, replicas))
        if load is None:
            return replicas
        same = abs(1 - load / (self._target * replicas)) <= self.TOLERANCE
        proposed = replicas if same else math.ceil(load / self._target)
        self._proposed.append((now_s, min(max(proposed, self._least), self._most)))
        lowest = min(self._within(self._proposed, self._up["stabilizationWindowSeconds"], now_s))
        highest = max(self._within(self._proposed, self._down["stabilizationWindowSeconds"], now_s))
        if replicas < lowest:
            return min(lowest, max(self._limits(self._up["policies"], now_s, 1)))
        if replicas > highest:
            return max(highest, min(self._limits(self._down["policies"], now_s, -1)))
        return replicas

    def _limits(self, policies: Sequence[Mapping[str, Any]], now_s: float, sign: int) -> list[int]:
        limits = []
        for policy in policies:
            before = self._within(self._replicas, policy["periodSeconds"], now_s)[0]
            change = policy["value"] if policy["type"] == "Pods" else before * policy["value"] / 100
            limits.append(math.ceil(before + change) if sign > 0 else math.floor(before - change))
        return limits

    @staticmethod
    def _within(noted: Sequence[tuple[float, int]], seconds: float, now_s: float) -> list[int]:
        return [value for at_s, value in noted if now_s - at_s <= seconds]
