import pytest

from gateway.discovery import DiscoverySettings, plan
from gateway.discovery.published_topics import Topic as Published
from services.simulator.topics import SimulatedStream, topics

DEPTH = {True: "/camera/aligned_depth_to_color", False: "/camera/depth"}
IMAGE = {True: "image_raw", False: "image_rect_raw"}


def offered(streams: list[SimulatedStream], *, aligned: bool, namespace: str = "") -> dict[str, str]:
    """Return by stream the topic that a gateway without settings takes."""
    found = [
        Published(f"{namespace}/{topic.name}", topic.type, ("/simulated",))
        for topic in topics(streams, aligned=aligned)
    ]
    return {key.name: source.topic for key, source in plan(found, DiscoverySettings("r1")).streams.items()}


@pytest.mark.parametrize("aligned", [True, False])
@pytest.mark.parametrize("namespace", ["", "/r1"])
def test_a_gateway_makes_one_camera_and_one_lidar_of_it(aligned: bool, namespace: str) -> None:  # noqa: FBT001
    found = offered(list(SimulatedStream), aligned=aligned, namespace=namespace)
    assert found == {
        "tf": f"{namespace}/tf",
        "tf_static": f"{namespace}/tf_static",
        "camera/color": f"{namespace}/camera/color/image_raw",
        "camera/info": f"{namespace}/camera/color/camera_info",
        "camera/depth": f"{namespace}{DEPTH[aligned]}/{IMAGE[aligned]}",
        "camera/depth_info": f"{namespace}{DEPTH[aligned]}/camera_info",
        "camera/points": f"{namespace}/camera/depth/color/points",
        "velodyne/points": f"{namespace}/velodyne_points",
    }


def test_what_was_not_asked_for_is_not_there() -> None:
    assert offered([SimulatedStream.LIDAR], aligned=True).keys() == {"tf", "tf_static", "velodyne/points"}
    assert offered([SimulatedStream.COLOR], aligned=True).keys() == {"tf", "tf_static", "camera/color", "camera/info"}


def test_only_what_never_changes_is_latched() -> None:
    assert [topic.name for topic in topics(list(SimulatedStream), aligned=True) if topic.latched] == ["tf_static"]
