import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.keys import matches
from schemas import consumer_keys, keys
from schemas.consumer_keys import Wanted
from schemas.errors import SchemaError
from schemas.keys import TF, CameraKey, RobotStreamKey, Stream, StreamKey

names = st.from_regex(keys.NAME, fullmatch=True)


@given(names, names.filter(lambda name: name not in keys.RESERVED), st.sampled_from(Stream))
def test_stream_keys_parse_back(robot: str, camera: str, stream: Stream) -> None:
    key = CameraKey(robot, camera)
    assert keys.parse_stream(key.stream(stream)) == StreamKey(key, stream)
    assert keys.parse_stream(key.alive(stream)) == StreamKey(key, stream)


@given(names)
def test_robot_keys_parse_back(name: str) -> None:
    assert keys.parse_robot(keys.robot_alive(name)) == name
    assert keys.parse_robot(keys.gateway_status(name)) == name


@given(names, names.filter(lambda name: name not in keys.RESERVED))
def test_what_consumers_can_use_parses_back(robot: str, camera: str) -> None:
    key = CameraKey(robot, camera)
    assert consumer_keys.parse_budget(consumer_keys.budget(key, robot)) == (key, robot)
    assert matches(consumer_keys.budget(key, robot), consumer_keys.every_budget(robot))


@pytest.mark.parametrize("key", ["workers/detector/w1/1/alive", "fleet/r1/ros/budget/w", "fleet/r1/front/budget"])
def test_other_keys_are_no_budgets(key: str) -> None:
    with pytest.raises(SchemaError):
        consumer_keys.parse_budget(key)


@given(
    names,
    names.filter(lambda name: name not in keys.RESERVED),
    st.sampled_from(sorted(keys.SENSOR_STREAMS)),
    names,
    names,
)
def test_a_consumers_token_says_what_it_wants_and_where(
    robot: str, camera: str, stream: Stream, clock_id: str, consumer: str
) -> None:
    token = Wanted(StreamKey(CameraKey(robot, camera), stream), clock_id, consumer)
    assert str(token) == f"fleet/{robot}/{camera}/{stream}/wanted/{clock_id}/{consumer}"
    assert consumer_keys.parse_wanted(str(token)) == token
    assert matches(str(token), consumer_keys.every_wanted(robot))


@given(names, st.sampled_from(sorted(keys.ROBOT_STREAMS)), names, names)
def test_so_does_the_token_of_who_wants_a_whole_robots_stream(
    robot: str, stream: str, clock_id: str, consumer: str
) -> None:
    token = Wanted(RobotStreamKey(robot, stream), clock_id, consumer)
    assert str(token) == f"fleet/{robot}/{stream}/wanted/{clock_id}/{consumer}"
    assert consumer_keys.parse_wanted(str(token)) == token
    assert matches(str(token), consumer_keys.every_wanted(robot))


@pytest.mark.parametrize("certificate", ["", "ann", "gpu-1.local", "a b", "a" * 64])
def test_new_consumers_are_told_apart_and_their_names_can_be_keys(certificate: str) -> None:
    key = RobotStreamKey("r1", TF)
    one, other = (Wanted(key, "clock", consumer_keys.new_consumer(certificate)) for _ in range(2))
    assert one != other
    assert consumer_keys.parse_wanted(str(one)) == one


def test_a_new_consumers_name_begins_with_its_certificates_and_a_dash() -> None:
    assert consumer_keys.new_consumer("gpu-1.local").startswith("gpu-1.local-")
    assert "-" not in consumer_keys.new_consumer("")


@pytest.mark.parametrize(
    "key",
    [
        "fleet/r1/front/color/wanted/a",
        "fleet/r1/front/color/wanted/a/b/c",
        "fleet/r1/wanted/a/b",
        "wanted/a/b",
        "a",
        "fleet/r1/status/wanted/a/b",
    ],
)
def test_other_keys_are_no_consumers_tokens(key: str) -> None:
    with pytest.raises(SchemaError):
        consumer_keys.parse_wanted(key)


@given(st.text(max_size=80))
def test_whatever_the_key_parsing_raises_schema_errors_only(key: str) -> None:
    for parse in (
        keys.parse_stream,
        keys.parse_robot,
        consumer_keys.parse_budget,
        consumer_keys.parse_wanted,
        keys.parse_service,
    ):
        try:
            parse(key)
        except SchemaError:
            continue


@pytest.mark.parametrize("name", ["", "a/b", "*", "a*", "$x", "@a", "-a", ".a", "a b", "ä", "a\n", "a" * 65])
def test_names_that_cannot_be_chunks(name: str) -> None:
    with pytest.raises(SchemaError, match="camera name"):
        CameraKey("r1", name)
    with pytest.raises(SchemaError, match="robot name"):
        keys.robot_alive(name)


@pytest.mark.parametrize("name", sorted(keys.RESERVED))
def test_reserved_camera_names(name: str) -> None:
    with pytest.raises(SchemaError, match="reserved"):
        CameraKey("r1", name)


@pytest.mark.parametrize(
    "key",
    [
        "fleet/r1/front",
        "fleet/r1/front/smell",
        "fleet/r1/front/color/x",
        "other/r1/front/color",
        "fleet/r1/*/color",
        "fleet/r1/front/overlay",
        "fleet/r1/front/overlay/detection/x",
    ],
)
def test_other_keys_are_no_streams(key: str) -> None:
    with pytest.raises(SchemaError):
        keys.parse_stream(key)


@given(names, names.filter(lambda name: name not in keys.RESERVED), st.sampled_from(sorted(keys.SENSOR_STREAMS)))
def test_what_sensors_send_is_named_by_camera_and_stream(robot: str, camera: str, stream: Stream) -> None:
    key = keys.sensor_key(robot, f"{camera}/{stream}")
    assert key == StreamKey(CameraKey(robot, camera), stream)
    assert (str(key), key.alive) == (f"fleet/{robot}/{camera}/{stream}", f"fleet/{robot}/{camera}/{stream}/alive")


@pytest.mark.parametrize("stream", sorted(keys.ROBOT_STREAMS))
def test_what_belongs_to_the_whole_robot_has_no_camera(stream: str) -> None:
    key = keys.sensor_key("r1", stream)
    assert key == RobotStreamKey("r1", stream)
    assert (str(key), key.alive) == (f"fleet/r1/{stream}", f"fleet/r1/{stream}/alive")
    assert keys.parse_robot(str(key)) == "r1"


@pytest.mark.parametrize(
    "name",
    [
        "",
        "front",
        "front/smell",
        "front/classes",
        "status",
        "alerts",
        "actions",
        "tf/x",
        "ros",
        "ros/",
        "ros//a",
        "ros/*",
        "text/a b",
        "ros/a/alive",
        "ros/" + "a/" * 98 + "bc",
        "a b/depth",
        "/tf",
    ],
)
def test_other_names_are_no_sensor_streams(name: str) -> None:
    with pytest.raises(SchemaError):
        keys.sensor_key("r1", name)


@pytest.mark.parametrize("stream", ["ros/battery", "ros/arm/joint_states", "text/mode", "ros/" + "a/" * 98])
def test_named_streams_are_one_each(stream: str) -> None:
    key = RobotStreamKey("r1", stream.rstrip("/"))
    assert keys.sensor_key("r1", stream.rstrip("/")) == key
    assert (str(key), key.kind) == (f"fleet/r1/{key.stream}", stream[:4].rstrip("/"))
    assert key.alive == f"fleet/r1/{key.stream}/alive"


@pytest.mark.parametrize("kind", sorted(keys.NAMED_STREAMS))
def test_no_named_stream_has_the_key_of_a_cameras_budgets(kind: str) -> None:
    assert matches(f"fleet/r1/{kind}/budget/arm", consumer_keys.every_budget("r1"))
    with pytest.raises(SchemaError, match="'budget' is reserved"):
        RobotStreamKey("r1", f"{kind}/budget/arm")
    assert RobotStreamKey("r1", f"{kind}/arm/budget").name == f"{kind}/arm/budget"


@pytest.mark.parametrize("stream", sorted(keys.ROBOT_RESULTS))
def test_what_a_robot_is_sent_has_no_camera(stream: str) -> None:
    key = RobotStreamKey("r1", stream)
    assert (str(key), key.kind) == (f"fleet/r1/{stream}", stream)
    assert keys.parse_robot(str(key)) == "r1"


def test_an_overlay_is_two_chunks_of_a_key() -> None:
    key = CameraKey("r1", "front")
    assert key.stream(Stream.OVERLAY_DETECTION) == "fleet/r1/front/overlay/detection"
    assert keys.parse_stream("fleet/r1/front/overlay/segmentation/alive") == StreamKey(key, Stream.OVERLAY_SEGMENTATION)


@given(names, st.from_regex(keys.SERVICE, fullmatch=True).filter(lambda name: len(name) <= keys.MAX_NAMED))
def test_service_keys_parse_back(robot: str, service: str) -> None:
    key = keys.service(robot, service)
    assert key == f"fleet/{robot}/service{service}"
    assert keys.parse_service(key) == (robot, service)


@pytest.mark.parametrize("name", ["", "/", "reset", "/a/", "/a//b", "/a b", "/*", "/ä", "/a" * 101])
def test_names_that_are_no_service(name: str) -> None:
    with pytest.raises(SchemaError, match="not the name of a ROS service"):
        keys.service("r1", name)


@pytest.mark.parametrize(
    "key", ["fleet/r1/service", "fleet/r1/service/", "fleet/r1/clock", "fleet/r1/services/a", "x/r1/service/a"]
)
def test_other_keys_are_no_services(key: str) -> None:
    with pytest.raises(SchemaError):
        keys.parse_service(key)


def test_a_robots_clock_has_a_key() -> None:
    assert keys.robot_clock("r1") == "fleet/r1/clock"
    assert keys.parse_robot("fleet/r1/clock") == "r1"


def test_whose_a_stream_is() -> None:
    assert keys.owner_of(StreamKey(CameraKey("r1", "front"), Stream.DEPTH)) == ("r1", "front")
    assert keys.owner_of(RobotStreamKey("r1", "tf")) == ("r1", "")
