"""A gateway's node and a ROS node that subscribes to all its results, at an embedded ROS master."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import pytest

from gateway.process import warn_of_recorders
from gateway.ros1.node import Node
from gateway.to_ros.outputs import STRING, cure, recorders
from services.simulator.ros_master.master import RosMaster
from tests.waiting import until

RESULTS = ("/ultralytics/detection/classes", "/ultralytics/detection/distance", "/ultralytics/alerts")
RECORDER = "/record_1764000000"


@pytest.fixture
async def master() -> AsyncIterator[RosMaster]:
    async with RosMaster() as running:
        yield running


@pytest.mark.parametrize(
    ("passive", "level", "what"),
    [
        (False, "WARNING", "as `rosbag record -a` does, so workers make all of them of every camera"),
        (True, "INFO", "it is passive, so it makes none of them wanted"),
    ],
)
async def test_who_subscribes_to_all_results_is_said_once(
    master: RosMaster, caplog: pytest.LogCaptureFixture, *, passive: bool, level: str, what: str
) -> None:
    caplog.set_level("INFO", "gateway.process")
    async with AsyncExitStack() as stack:
        enter = stack.enter_async_context
        gateway = await enter(Node("/fleetsight_gateway_r1", master_uri=master.uri, poll_interval=0.05))
        recorder = await enter(Node(RECORDER, master_uri=master.uri, poll_interval=0.05))
        for topic in RESULTS:
            await enter(gateway.advertise(topic, STRING))
        await enter(gateway.advertise("/planner/stop", STRING))
        watching = asyncio.create_task(warn_of_recorders(gateway, lambda node: passive and node == RECORDER))
        for topic in RESULTS[1:]:
            await enter(recorder.subscribe(topic, STRING, lambda _: None))
        await until(lambda: recorder.registered and gateway.registered, "both are registered")
        await asyncio.sleep(0.3)
        assert caplog.records == []
        await enter(recorder.subscribe(RESULTS[0], STRING, lambda _: None))
        await until(lambda: bool(caplog.records), "it is said")
        await asyncio.sleep(0.3)
        (record,) = caplog.records
        watching.cancel()
        await asyncio.wait([watching])
    assert record.levelname == level
    assert record.getMessage().startswith(f"{RECORDER} subscribes to all 3 results")
    assert what in record.getMessage()


def test_of_one_topic_alone_nobody_is_a_recorder() -> None:
    assert recorders(RESULTS[:1], {RESULTS[0]: ["/planner"]}) == recorders([], {}) == []
    assert recorders(RESULTS[:2], {RESULTS[0]: ["/b", "/a"], RESULTS[1]: ["/a", "/b"]}) == ["/a", "/b"]


def test_a_recorder_is_left_out_by_a_name_that_it_has_next_time_too() -> None:
    assert "--passive-subscribers '/record_.*'" in cure(RECORDER)
    assert "--passive-subscribers '/all'" in cure("/all")
