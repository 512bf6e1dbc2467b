from gateway.doctor.evidence import Graph
from gateway.doctor.robot import beside, left_out, planned
from gateway.settings import GatewaySettings
from schemas.keys import SensorKey

IMAGE, INFO, COMPRESSED = "sensor_msgs/Image", "sensor_msgs/CameraInfo", "sensor_msgs/CompressedImage"


def streams(**topics: str) -> dict[SensorKey, str]:
    named = {name.replace("__", "/"): topic for name, topic in topics.items()}
    settings = GatewaySettings(robot="r1", ros_host="robot", cameras={"front": "/front/color"}, topics=named)
    return {key: source.topic for key, source in planned(settings, Graph()).streams.items()}


def names(found: object) -> dict[str, str]:
    return (
        {str(key).removeprefix("fleet/r1/"): topic for key, topic in found.items()} if isinstance(found, dict) else {}
    )


def test_the_mapping_is_the_gateways() -> None:
    assert names(streams(front__depth="/front/depth", tf="/tf")) == {
        "front/color": "/front/color",
        "front/depth": "/front/depth",
        "tf": "/tf",
    }


def test_what_is_not_named_is_found_and_the_rest_left_out() -> None:
    published = {"/front/image_raw": IMAGE, "/front/image_rect": IMAGE, "/mode": "std_msgs/String"}
    graph = Graph(publishers=dict.fromkeys(published, ("/driver",)), types=published)
    found = planned(GatewaySettings(robot="r1", ros_host="robot"), graph)
    assert {str(key): source.topic for key, source in found.streams.items()} == {
        "fleet/r1/front/color": "/front/image_raw"
    }
    assert list(left_out(found, graph)) == ["/front/image_rect"]


def test_calibrations_are_found_beside_the_images() -> None:
    graph = Graph(types={"/front/camera_info": INFO, "/front/depth/camera_info": INFO, "/camera_info": INFO})
    found = beside(streams(front__depth="/front/depth/image_raw"), graph, sim_time=False)
    assert names(found) == {"front/info": "/front/camera_info", "front/depth_info": "/front/depth/camera_info"}


def test_a_calibration_that_two_images_share_is_colours() -> None:
    graph = Graph(types={"/front/camera_info": INFO})
    found = beside(streams(front__depth="/front/depth"), graph, sim_time=False)
    assert names(found) == {"front/info": "/front/camera_info"}


def test_the_calibration_of_a_compressed_image_is_beside_what_was_compressed() -> None:
    graph = Graph(types={"/front/depth/image_raw/compressedDepth": COMPRESSED, "/front/depth/camera_info": INFO})
    found = beside(streams(front__depth="/front/depth/image_raw/compressedDepth"), graph, sim_time=False)
    assert names(found) == {"front/depth_info": "/front/depth/camera_info"}


def test_the_calibration_of_disparities_is_that_of_the_left_camera() -> None:
    graph = Graph(types={"/stereo/left/camera_info": INFO})
    found = beside(streams(front__depth="/stereo/disparity"), graph, sim_time=False)
    assert names(found) == {"front/depth_info": "/stereo/left/camera_info"}


def test_what_is_a_stream_already_or_of_another_type_is_left_alone() -> None:
    graph = Graph(
        publishers={"/tf_static": ("/a",)},
        types={"/front/camera_info": "std_msgs/String", "/tf_static": "tf2_msgs/TFMessage"},
    )
    assert names(beside(streams(tf_static="/tf_static"), graph, sim_time=False)) == {}


def test_transforms_and_the_simulated_clock() -> None:
    graph = Graph(publishers={"/tf_static": ("/a",), "/tf": ("/b",)})
    found = beside(streams(), graph, sim_time=True)
    assert names(found) == {"tf": "/tf", "tf_static": "/tf_static", "ros/clock": "/clock"}
