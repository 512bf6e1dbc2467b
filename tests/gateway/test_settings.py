import pytest
from pydantic import ValidationError

from gateway.settings import GatewaySettings


def settings(**fields: object) -> GatewaySettings:
    return GatewaySettings.model_validate({"robot": "r1", **fields})


@pytest.mark.parametrize(
    ("environment", "host"),
    [({"ROS_HOSTNAME": "robot", "ROS_IP": "10.0.0.1"}, "robot"), ({"ROS_IP": "10.0.0.1"}, "10.0.0.1")],
)
def test_ros_own_variables_are_the_defaults(
    environment: dict[str, str], host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ROS_HOSTNAME", "ROS_IP"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {**environment, "ROS_MASTER_URI": "http://robot:11399/"}.items():
        monkeypatch.setenv(name, value)
    assert settings().ros_host == host
    assert settings().ros_master == "http://robot:11399"
    assert settings(ros_host="other").ros_host == "other"


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("robot", "", "robot name"),
        ("robot", "r/1", "robot name"),
        ("robot", "a\n", "robot name"),
        ("ros_master", "robot:11311", "use one like http://robot:11311"),
        ("ros_master", "http://robot", "use one like http://robot:11311"),
        ("ros_master", "http://::1:11311", "use one like http://robot:11311 or http://[fd00::7]:11311"),
        ("allow", "(", "not a regular expression: missing )"),
        ("deny", "/a[", "not a regular expression: unterminated character set"),
        ("passive_subscribers", "/a[", "not a regular expression: unterminated character set"),
        ("cameras", {"status": "/image"}, "camera name 'status' is reserved"),
        ("cameras", {"a/b": "/image"}, "camera name 'a/b'"),
        ("cameras", {"front": "7/image"}, "camera front: '7/image' is not a ROS topic"),
        ("cameras", {"front": "~image"}, "camera front: '~image' is not a ROS topic"),
        ("namespace", "a b", "not a ROS name: '/a b'"),
        ("node_name", "/a/b", "a node's name is one word"),
        ("node_name", "a b", "not a ROS name: '/a b'"),
        ("remap", {"/a": "b c"}, "not a ROS name: 'b c'"),
        ("remap", {"": "/b"}, "not a ROS name: ''"),
        ("cameras", {"front": "/image//raw"}, "is not a ROS topic"),
        ("cameras", {"front": "/" + "a" * 256}, "is not a ROS topic"),
        ("ros_master", "http://robot:99999", "use one like http://robot:11311"),
        ("ros_host", "bad host", "neither a host name nor an address"),
        ("ros_host", "ab:cd", "neither a host name nor an address"),
        ("cameras", {"front": "/ultralytics/detection/image"}, "camera front: /ultralytics/detection/image is where"),
        ("cameras", {"front": "/ultralytics"}, "gateways publish results"),
        ("topics", {"front/depth": "-depth"}, "stream front/depth: '-depth' is not a ROS topic"),
        ("topics", {"front": "/depth"}, "not a stream that sensors send: 'front'; one looks like front/depth or tf"),
        ("topics", {"front/smell": "/depth"}, "not a stream that sensors send: 'front/smell'"),
        ("topics", {"front/classes": "/classes"}, "not a stream that sensors send: 'front/classes'"),
        ("topics", {"status": "/status"}, "not a stream of a whole robot: 'status'"),
        ("topics", {"ros": "/battery"}, "not a stream of a whole robot: 'ros'"),
        ("topics", {"ros/a b": "/battery"}, "stream name 'a b'"),
        ("topics", {"a b/depth": "/depth"}, "camera name 'a b'"),
        ("topics", {"alerts": "/alerts"}, "not a stream that sensors send: 'alerts'"),
        ("actions", {"pick up": "/planner/pick_up"}, "'pick up' is not an action's name; use one like pick_up"),
        ("actions", {"pick_up": "pick up"}, "action pick_up: 'pick up' is not a ROS topic"),
        ("actions", {"pick_up": "/ultralytics/alerts"}, "action pick_up: /ultralytics/alerts is where gateways"),
    ],
)
def test_what_is_wrong_is_named(field: str, value: object, reason: str) -> None:
    with pytest.raises(ValidationError) as caught:
        settings(**{field: value})
    (mistake,) = caught.value.errors()
    assert mistake["loc"][0] == field
    assert reason in mistake["msg"]


@pytest.mark.parametrize(
    ("given", "discovers"),
    [
        ({}, True),
        ({"cameras": {"front": "/image"}}, False),
        ({"topics": {"tf": "/tf"}}, False),
        ({"cameras": {"front": "/image"}, "discover": True}, True),
    ],
)
def test_streams_are_discovered_where_none_are_named_or_where_asked_for(
    given: dict[str, object], *, discovers: bool
) -> None:
    assert settings(**given).discovery_settings().discover is discovers


def test_neither_discovered_nor_named_is_nothing() -> None:
    with pytest.raises(ValidationError, match="--no-discover leaves nothing to send unless --cameras or --topics"):
        settings(discover=False)


def test_nodes_are_passive_by_their_whole_names() -> None:
    made = settings(passive_subscribers="/record_.*|/bag")
    assert [made.is_passive(node) for node in ("/record_17", "/bag", "/bag2", "/planner")] == [True, True, False, False]
    assert not settings().is_passive("/record_17")


def test_patterns_are_of_whole_names() -> None:
    discovery_settings = settings(allow="/r1/.*|/tf", deny="/r1/infra.*").discovery_settings()
    assert discovery_settings.allow.fullmatch("/tf")
    assert not discovery_settings.allow.fullmatch("/tf_static")
    assert discovery_settings.deny.fullmatch("/r1/infra1/image_raw")
    assert not settings().discovery_settings().deny.fullmatch("/tf")


def test_a_topic_that_only_begins_like_results_is_a_sensors() -> None:
    assert settings(cameras={"front": "/ultralytics_camera/image_raw"}).cameras


def test_every_stream_has_its_topic() -> None:
    given = settings(cameras={"front": "/color"}, topics={"front/depth": "/depth", "rear/color": "/rear", "tf": "/tf"})
    assert {str(key): topic for key, topic in given.streams().items()} == {
        "fleet/r1/front/color": "/color",
        "fleet/r1/front/depth": "/depth",
        "fleet/r1/rear/color": "/rear",
        "fleet/r1/tf": "/tf",
    }


@pytest.mark.parametrize(
    ("topics", "reason"),
    [
        ({"front/depth": "/ultralytics/detection/image"}, "is where gateways publish results"),
        ({"front/depth": "/color"}, "stream front/color and stream front/depth would both be /color"),
        ({"front/info": "/info", "front/depth_info": "/info"}, "would both be /info"),
        ({"front/color": "/other"}, "--cameras and --topics both give front/color"),
    ],
)
def test_a_topic_has_one_stream_and_a_stream_one_topic(topics: dict[str, str], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        settings(cameras={"front": "/color"}, topics=topics)


def test_no_action_is_allowed_unless_it_is_named() -> None:
    assert settings().actions == {}
    assert settings(actions={"pick_up": "/planner/pick_up"}).actions == {"pick_up": "/planner/pick_up"}


RESULT = "ultralytics/detection/image"


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"topics": {"text/mode": "/mode"}, "actions": {"set_mode": "/mode"}}, "stream text/mode and action set_mode"),
        ({"actions": {"pick_up": "/x", "stop": "/x"}}, "action pick_up and action stop would both be /x"),
        ({"cameras": {"a": "/a", "b.c": "/b", "b-c": "/c"}}, "classes of b.c and classes of b-c would both be"),
        ({"actions": {"a": "/x", "b": "y"}, "remap": {"y": "/x"}}, "action a and action b would both be /x"),
        (
            {"cameras": {"c": "/c"}, "topics": {"front-1/color": "/a", "front_1/color": "/b"}},
            "classes of front-1 and classes of front_1 would both be /ultralytics/front_1/detection/classes",
        ),
        ({"remap": {RESULT: "/x", "ultralytics/alerts": "/x"}}, "the alerts and overlay/detection of the first camera"),
        ({"remap": {RESULT: "/a"}, "cameras": {"front": "/a"}}, "stream front/color and overlay/detection of front"),
        ({"topics": {"ros/clock": "/clock"}}, "stream ros/clock and the time that the gateway itself follows"),
    ],
)
def test_a_ros_topic_has_one_use(given: dict[str, dict[str, str]], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        settings(**given)


def test_a_ros_topic_whose_other_use_is_turned_off_can_be_used() -> None:
    assert not settings(remap={RESULT: "/a"}, cameras={"front": "/a"}, results=False).results
    first_has_no_name = settings(topics={"front-1/color": "/a", "front_1/color": "/b"})
    assert sorted(first_has_no_name.streams().values()) == ["/a", "/b"]


@pytest.mark.parametrize("namespace", ["r1", "/r1", "/r1/"])
def test_relative_names_are_in_the_namespace(namespace: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_NAMESPACE", namespace)
    given = settings(cameras={"front": "color", "rear": "/rear"})
    assert sorted(given.streams().values()) == ["/r1/color", "/rear"]
    assert given.names("gateway_x").node == "/r1/gateway_x"
    assert settings(namespace="/").names("gateway_x").node == "/gateway_x"
    assert settings(node_name="gw").names("gateway_x").node == "/r1/gw"


def test_topics_are_remapped_and_have_one_stream_each_afterwards() -> None:
    remap = {"/camera/color/image_raw": "front/image", "tf": "/shared/tf"}
    cameras = {"camera": "/camera/color/image_raw"}
    given = settings(namespace="r1", remap=remap, cameras=cameras, topics={"tf": "tf", "tf_static": "/tf_static"})
    assert set(given.streams().values()) == {"/r1/front/image", "/shared/tf", "/tf_static"}
    with pytest.raises(ValidationError, match="stream camera/color and stream tf_static would both be /tf_static"):
        settings(remap={"/camera/color/image_raw": "/tf_static"}, cameras=cameras, topics={"tf_static": "/tf_static"})


def test_rectified_pictures_are_named() -> None:
    discovery_settings = GatewaySettings(robot="r1", rectified=["front/color", "front/depth"]).discovery_settings()
    assert {key.name for key in discovery_settings.rectified} == {"front/color", "front/depth"}


@pytest.mark.parametrize("name", ["front", "front/info", "front/points", "tf", "ros/front"])
def test_what_is_no_picture_cannot_be_rectified(name: str) -> None:
    with pytest.raises(ValidationError, match=r"not a stream that sensors send|not a camera's image stream"):
        GatewaySettings(robot="r1", rectified=[name])


def test_services_are_listed_by_name_and_maybe_type() -> None:
    settings = GatewaySettings(robot="r1", services=["/reset", "/arm/stop=std_srvs/Trigger"])
    assert settings.listed_services() == {"/reset": "*", "/arm/stop": "std_srvs/Trigger"}
    assert GatewaySettings(robot="r1").listed_services() == {}


@pytest.mark.parametrize(
    ("services", "reason"),
    [
        (["reset"], "not the name of a ROS service"),
        (["/reset*"], "not the name of a ROS service"),
        (["/reset=Trigger"], "not a ROS message type"),
        (["/reset="], "not a ROS message type"),
        (["/a", "/a=b/C"], "/a is named twice"),
        ([f"/s{n}" for n in range(65)], "65 services, at most 64"),
    ],
)
def test_services_that_are_refused(services: list[str], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        GatewaySettings(robot="r1", services=services)


def test_a_message_of_24_megapixels_is_read_unless_told_otherwise() -> None:
    assert GatewaySettings(robot="r1").max_message_bytes > 6_000 * 4_000 * 3
    assert GatewaySettings(robot="r1", max_message_mib=1_024).max_message_bytes == 1 << 30
    for refused in (0, 1_025):
        with pytest.raises(ValidationError, match="max_message_mib"):
            GatewaySettings(robot="r1", max_message_mib=refused)
