"""Which topics the doctor looks at. Pure."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final

from gateway.discovery import Plan, plan, unclear
from gateway.discovery.plan import INFOS
from gateway.discovery.sieve import OF_GATEWAYS, TYPES
from gateway.discovery.topics import calibrations_of, topics_of
from gateway.doctor.evidence import Graph
from gateway.doctor.stamps import CLOCK
from gateway.ros1.sim_clock import TOPIC as SIM_CLOCK
from gateway.settings import GatewaySettings
from gateway.translators.camera_info import TYPE_NAME as CAMERA_INFO
from schemas.keys import TF, TF_STATIC, SensorKey, StreamKey, owner_of, sensor_key

NOTHING_HEARD: Final[Mapping[str, str]] = MappingProxyType({})


def planned(settings: GatewaySettings, graph: Graph, encodings: Mapping[str, str] = NOTHING_HEARD) -> Plan:
    """Return what a gateway with the settings would take, were it started now. encodings: of images, by topic."""
    topics = topics_of(graph.publishers, graph.types)
    return plan([replace(each, encoding=encodings.get(each.name, "")) for each in topics], settings.wishes())


def to_sample(settings: GatewaySettings, graph: Graph) -> list[str]:
    """Return the topics of images of which the gateway looks at one message first."""
    return [topic.name for topic in unclear(topics_of(graph.publishers, graph.types), settings.wishes())]


def undiscovered(settings: GatewaySettings, graph: Graph) -> list[str]:
    """Return the topics that a gateway would take as well if it discovered streams beside those that are named."""
    if settings.discover:
        return []
    wishes = replace(settings.wishes(), discover=True)
    found = plan(topics_of(graph.publishers, graph.types), wishes).streams
    return sorted({source.topic for source in found.values()} - set(wishes.named.values()))


def left_out(found: Plan, graph: Graph) -> Mapping[str, str]:
    """Return why a topic of a type that sensors have is not taken, by its name."""
    return {
        topic: why for topic, why in found.left_out.items() if graph.types.get(topic) in TYPES and why != OF_GATEWAYS
    }


def beside(streams: Mapping[SensorKey, str], graph: Graph, *, sim_time: bool) -> Mapping[SensorKey, str]:
    """Return further topics that tell about the streams: calibrations, transforms, the simulation's clock."""
    robot = next((owner_of(key)[0] for key in streams), "")
    found: dict[SensorKey, str] = dict(_calibrations(streams, graph))
    for name in (TF, TF_STATIC):
        if f"/{name}" in graph.publishers and robot:
            found[sensor_key(robot, name)] = f"/{name}"
    if sim_time and robot:
        found[sensor_key(robot, CLOCK)] = SIM_CLOCK
    return {key: topic for key, topic in found.items() if key not in streams}


def _calibrations(streams: Mapping[SensorKey, str], graph: Graph) -> Iterator[tuple[SensorKey, str]]:
    taken = set(streams.values())
    for key, topic in streams.items():
        if isinstance(key, StreamKey) and key.stream in INFOS:
            infos = (name for name in calibrations_of(topic) if graph.types.get(name) == CAMERA_INFO)
            info = next((name for name in infos if name not in taken), None)
            if info is not None:
                taken.add(info)
                yield StreamKey(key.camera, INFOS[key.stream]), info
