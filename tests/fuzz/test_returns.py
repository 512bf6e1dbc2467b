"""Whatever arrives under a result's key, ROS gets a whole message of the topic's type, or the result is counted out."""

import ast
import json
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.to_ros.actions import AHEAD, EARLIER, OLD, FreshActions
from gateway.to_ros.outputs import POINT, actions_return, alerts_return, camera_returns
from gateway.to_ros.stream import MALFORMED, REFUSED, StreamReturn
from schemas import codec
from schemas.codec import Message
from schemas.keys import CameraKey, RobotStreamKey
from tests.gateway.to_ros.lists import class_list
from tests.gateway.to_ros.namespaces import IN_ROOT
from tests.gateway.to_ros.overlays import overlay
from tests.gateway.to_ros.taking import status, take
from tests.schemas import frames
from tests.schemas.results import action, alert, cloud, clouds, distances, known, unknown

SENT_NS = 1_700_000_000_000_000_000
RESULTS: dict[str, Message] = {
    "classes": class_list(("box", 2), ("pallet", 1)),
    "distances": distances(known("box", 2.5), unknown("pallet")),
    "overlay/detection": overlay(height=8, width=16),
    "overlay/segmentation": frames.image(),
    "objects": clouds(cloud((0.0, 0.5, 2.0), rgb=b"rgb"), cloud((1.0, 0.5, 2.0))),
    "alerts": alert(),
    "actions": msgspec.structs.replace(action(), sent_ns=SENT_NS),
}
scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary()
values = st.recursive(scalars, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20)
counts = st.lists(st.tuples(st.text(max_size=300), st.integers(-1, 3) | st.integers(0, 2**64 - 1)), max_size=5)


def stream_of(name: str) -> StreamReturn[Any]:
    if name == "actions":
        stream = actions_return("r1", {"pick_up": "/planner/pick_up"}, IN_ROOT)
        stream._novelty = FreshActions(RobotStreamKey("r1", "actions"), wall_ns=lambda: SENT_NS)
        return stream
    made = [*camera_returns(CameraKey("r1", "front"), "/ultralytics", IN_ROOT), alerts_return("r1", IN_ROOT)]
    return next(stream for stream in made if str(stream.key).endswith(f"/{name}"))


def check(name: str, payload: bytes) -> None:
    stream = stream_of(name)
    message = take(stream, payload)
    if message is None:
        assert status(stream).published == 0
        assert status(stream).dropped in [{reason: 1} for reason in (MALFORMED, REFUSED, OLD, EARLIER, AHEAD)]
        return
    assert (status(stream).published, status(stream).dropped) == (1, {})
    match name:
        case "classes" | "distances":
            assert all(isinstance(said, str) for said in ast.literal_eval(message.data))
        case "alerts":
            assert json.loads(message.data)["robot"] == "r1"
        case "overlay/detection" | "overlay/segmentation":
            assert message.data.size == message.height * message.step
        case "objects":
            assert message.data.size == message.width * POINT.itemsize
            assert np.isfinite(np.frombuffer(bytes(message.data), POINT)["xyz"]).all() == message.is_dense


@pytest.mark.parametrize("name", RESULTS)
@given(payload=st.binary(max_size=300))
def test_arbitrary_bytes(name: str, payload: bytes) -> None:
    check(name, payload)


@pytest.mark.parametrize("name", RESULTS)
@given(data=st.data())
def test_results_with_bytes_changed_or_cut(name: str, data: st.DataObject) -> None:
    payload = bytearray(codec.encode(RESULTS[name]))
    for _ in range(data.draw(st.integers(1, 4))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    check(name, bytes(payload[: data.draw(st.just(len(payload)) | st.integers(0, len(payload)))]))


@pytest.mark.parametrize("name", RESULTS)
@given(data=st.data())
def test_results_with_a_field_of_another_value(name: str, data: st.DataObject) -> None:
    fields = msgspec.to_builtins(RESULTS[name], builtin_types=(memoryview,))
    fields[data.draw(st.sampled_from(sorted(fields)))] = data.draw(values)
    check(name, msgspec.msgpack.encode(fields))


@given(counts)
def test_lists_of_any_names_and_counts(counted: list[tuple[str, int]]) -> None:
    check("classes", msgspec.msgpack.encode(class_list(*counted)))
