"""The doctor's process: examine, diagnose, report."""

import asyncio
import logging
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Final

from gateway.doctor.evidence import BusLook, Evidence, HostLook, StreamLook
from gateway.doctor.finding import Finding
from gateway.doctor.fleet import look_at_bus
from gateway.doctor.presence import check_fleet
from gateway.doctor.reachability import look_at_host
from gateway.doctor.report import as_json, as_text, diagnose, healthy
from gateway.doctor.robot import PoliteClient, RobotVisit, beside, left_out, planned, to_sample, undiscovered
from gateway.doctor.settings import DoctorSettings

MAX_WIDTH: Final = 120
UNWELL: Final = 1


async def run(settings: DoctorSettings) -> int:
    """Print the findings.

    Returns:
        The exit code: 0 when all is well.
    """
    with _quiet("bus", "gateway.ros1"):  # the report has what they would log
        findings = diagnose(await examine(settings)) if settings.robot else await survey(settings)
    width = min(shutil.get_terminal_size().columns, MAX_WIDTH)
    sys.stdout.write((as_json(findings) if settings.as_json else as_text(findings, width)) + "\n")
    return 0 if healthy(findings) else UNWELL


@contextmanager
def _quiet(*packages: str) -> Iterator[None]:
    loggers = [logging.getLogger(package) for package in packages]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


async def survey(settings: DoctorSettings) -> list[Finding]:
    """Examine all gateways of the fleet for the time in the settings."""
    bus = await look_at_bus(settings, seconds=settings.seconds, patience_s=settings.patience_s)
    return list(check_fleet(bus, settings.seconds))


async def examine(settings: DoctorSettings) -> Evidence:
    """Examine master, topics and bus at once, for the time in the settings."""
    async with asyncio.TaskGroup() as group:
        host = group.create_task(look_at_host(settings.ros_host, settings.patience_s))
        bus = group.create_task(look_at_bus(settings, seconds=settings.seconds, patience_s=settings.patience_s))
        robot = group.create_task(_visit(settings))
    return replace(robot.result(), host=host.result(), bus=bus.result())


async def _visit(settings: DoctorSettings) -> Evidence:
    """Examine the master, then the streams' topics and those related to them."""
    async with PoliteClient(timeout=settings.patience_s) as client:
        visit = RobotVisit(
            client,
            seconds=settings.seconds,
            patience_s=settings.patience_s,
            max_message_bytes=settings.max_message_bytes,
        )
        master = await visit.look_at_master(settings.ros_master)
        evidence = Evidence(
            settings.robot,
            settings.seconds,
            master,
            HostLook(settings.ros_host),
            BusLook(),
            discover=settings.discover,
            by_hand=frozenset(settings.streams()),
            passive=settings.passive_subscribers,
        )
        if master.graph is None:
            named = tuple(StreamLook(key, topic) for key, topic in settings.streams().items())
            return replace(evidence, streams=named)
        encodings = await visit.encodings(to_sample(settings, master.graph), master.graph)
        found = planned(settings, master.graph, encodings)
        streams = {key: source.topic for key, source in found.streams.items()}
        further = beside(streams, master.graph, sim_time=master.sim_time)
        looks = await visit.look_at_streams({**streams, **further}, master.graph, found.kind_of)
        return replace(
            evidence,
            streams=looks[: len(streams)],
            beside=looks[len(streams) :],
            left_out=left_out(found, master.graph),
            unused=settings.unused([key.name for key in found.streams]),
            undiscovered=undiscovered(settings, master.graph),
        )
