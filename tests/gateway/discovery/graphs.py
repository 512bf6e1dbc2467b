"""ROS graphs for tests, as drivers in the field make them."""

from collections.abc import Mapping
from dataclasses import replace

from gateway.discovery.plan import Plan
from gateway.discovery.published_topics import Topic
from schemas.keys import SensorKey, sensor_key

IMAGE = "sensor_msgs/Image"
COMPRESSED = "sensor_msgs/CompressedImage"
POINTS = "sensor_msgs/PointCloud2"
INFO = "sensor_msgs/CameraInfo"
DISPARITY = "stereo_msgs/DisparityImage"
TF = "tf2_msgs/TFMessage"
DRIVER = ("/driver",)


def graph(topics: Mapping[str, str], publishers: tuple[str, ...] = DRIVER) -> list[Topic]:
    """Return topics, given by type as one text."""
    return [Topic(name, kind, publishers) for kind, names in topics.items() for name in names.split()]


def heard(topics: list[Topic], **encodings: str) -> list[Topic]:
    """Return the topics with the encodings of those whose names have these words."""
    return [
        replace(topic, encoding=next((known for word, known in encodings.items() if word in topic.name), ""))
        if topic.type in {IMAGE, COMPRESSED, POINTS}
        else topic
        for topic in topics
    ]


def named(**topics: str) -> dict[SensorKey, str]:
    """Return topics by the streams of robot r1 that they are named for, front/color as front__color."""
    return {sensor_key("r1", name.replace("__", "/")): topic for name, topic in topics.items()}


def mapping(made: Plan) -> dict[str, str]:
    """Return topics by camera and stream."""
    return {key.name: source.topic for key, source in made.streams.items()}


REALSENSE = {
    IMAGE: "/camera/color/image_raw /camera/depth/image_rect_raw /camera/aligned_depth_to_color/image_raw "
    "/camera/aligned_depth_to_infra1/image_raw /camera/infra1/image_rect_raw /camera/infra2/image_rect_raw",
    COMPRESSED: "/camera/color/image_raw/compressed /camera/color/image_raw/compressedDepth "
    "/camera/aligned_depth_to_color/image_raw/compressed /camera/aligned_depth_to_color/image_raw/compressedDepth",
    "theora_image_transport/Packet": "/camera/color/image_raw/theora",
    POINTS: "/camera/depth/color/points",
    INFO: "/camera/color/camera_info /camera/depth/camera_info /camera/aligned_depth_to_color/camera_info "
    "/camera/infra1/camera_info",
    "realsense2_camera/Extrinsics": "/camera/extrinsics/depth_to_color",
    "sensor_msgs/Imu": "/camera/gyro/sample",
}
OPENNI = {
    IMAGE: "/camera/rgb/image_raw /camera/rgb/image_color /camera/rgb/image_rect_color /camera/rgb/image_mono "
    "/camera/depth/image_raw /camera/depth/image /camera/depth_registered/image_raw /camera/depth_registered/image "
    "/camera/depth_registered/sw_registered/image_rect /camera/ir/image_raw",
    POINTS: "/camera/depth_registered/points /camera/depth/points",
    INFO: "/camera/rgb/camera_info /camera/depth_registered/camera_info /camera/depth/camera_info",
    DISPARITY: "/camera/depth/disparity",
}
ASTRA = {
    IMAGE: "/camera/rgb/image_raw /camera/depth/image_raw /camera/ir/image",
    INFO: "/camera/rgb/camera_info /camera/depth/camera_info /camera/ir/camera_info",
    POINTS: "/camera/depth/points",
}
ZED = {
    IMAGE: "/zed/zed_node/rgb/image_rect_color /zed/zed_node/rgb_raw/image_raw_color "
    "/zed/zed_node/left/image_rect_color /zed/zed_node/left_raw/image_raw_color /zed/zed_node/right/image_rect_color "
    "/zed/zed_node/stereo/image_rect_color /zed/zed_node/rgb_gray/image_rect_gray "
    "/zed/zed_node/depth/depth_registered /zed/zed_node/confidence/confidence_map",
    POINTS: "/zed/zed_node/point_cloud/cloud_registered /zed/zed_node/mapping/fused_cloud",
    INFO: "/zed/zed_node/rgb/camera_info /zed/zed_node/depth/camera_info /zed/zed_node/left/camera_info",
    DISPARITY: "/zed/zed_node/disparity/disparity_image",
}
AZURE = {
    IMAGE: "/rgb/image_raw /depth/image_raw /depth_to_rgb/image_raw /rgb_to_depth/image_raw /ir/image_raw",
    POINTS: "/points2",
    INFO: "/rgb/camera_info /depth_to_rgb/camera_info",
}
STEREO = {
    IMAGE: "/stereo/left/image_raw /stereo/right/image_raw /stereo/left/image_rect",
    DISPARITY: "/stereo/disparity",
    POINTS: "/stereo/points2",
    INFO: "/stereo/left/camera_info /stereo/right/camera_info",
}
STEREO_IN_COLOR = {
    IMAGE: " ".join(
        f"/stereo/{side}/{leaf}"
        for side in ("left", "right")
        for leaf in ("image_raw", "image_mono", "image_rect", "image_color", "image_rect_color")
    ),
    DISPARITY: "/stereo/disparity",
    POINTS: "/stereo/points2",
    INFO: "/stereo/left/camera_info /stereo/right/camera_info",
}
OUSTER = {
    POINTS: "/os_cloud_node/points",
    IMAGE: "/img_node/range_image /img_node/signal_image /img_node/nearir_image /img_node/reflec_image",
    "ouster_ros/PacketMsg": "/os_node/lidar_packets",
}
TURTLEBOT = {
    IMAGE: "/camera/rgb/image_raw",
    COMPRESSED: "/camera/rgb/image_raw/compressed",
    INFO: "/camera/rgb/camera_info",
    "sensor_msgs/LaserScan": "/scan",
    "nav_msgs/OccupancyGrid": "/map /move_base/global_costmap/costmap",
    "std_msgs/String": "/diagnosis_text",
    TF: "/tf /tf_static",
}

DRIVERS: dict[str, tuple[dict[str, str], dict[str, str]]] = {
    "realsense": (
        REALSENSE,
        {
            "camera/color": "/camera/color/image_raw",
            "camera/depth": "/camera/aligned_depth_to_color/image_raw",
            "camera/points": "/camera/depth/color/points",
            "camera/info": "/camera/color/camera_info",
            "camera/depth_info": "/camera/aligned_depth_to_color/camera_info",
        },
    ),
    "openni": (
        OPENNI,
        {
            "camera/color": "/camera/rgb/image_raw",
            "camera/depth": "/camera/depth_registered/image_raw",
            "camera/points": "/camera/depth_registered/points",
            "camera/info": "/camera/rgb/camera_info",
            "camera/depth_info": "/camera/depth_registered/camera_info",
        },
    ),
    "astra": (
        ASTRA,
        {
            "camera/color": "/camera/rgb/image_raw",
            "camera/depth": "/camera/depth/image_raw",
            "camera/points": "/camera/depth/points",
            "camera/info": "/camera/rgb/camera_info",
            "camera/depth_info": "/camera/depth/camera_info",
        },
    ),
    "zed": (
        ZED,
        {
            "zed/color": "/zed/zed_node/rgb/image_rect_color",
            "zed/depth": "/zed/zed_node/depth/depth_registered",
            "zed/points": "/zed/zed_node/point_cloud/cloud_registered",
            "zed/info": "/zed/zed_node/rgb/camera_info",
            "zed/depth_info": "/zed/zed_node/depth/camera_info",
        },
    ),
    "azure": (
        AZURE,
        {
            "camera/color": "/rgb/image_raw",
            "camera/depth": "/depth_to_rgb/image_raw",
            "camera/points": "/points2",
            "camera/info": "/rgb/camera_info",
            "camera/depth_info": "/depth_to_rgb/camera_info",
        },
    ),
    "stereo": (
        STEREO,
        {
            "stereo/color": "/stereo/left/image_rect",
            "stereo/depth": "/stereo/disparity",
            "stereo/points": "/stereo/points2",
            "stereo/info": "/stereo/left/camera_info",
        },
    ),
    "stereo in colour": (
        STEREO_IN_COLOR,
        {
            "stereo/color": "/stereo/left/image_rect_color",
            "stereo/depth": "/stereo/disparity",
            "stereo/points": "/stereo/points2",
            "stereo/info": "/stereo/left/camera_info",
        },
    ),
    "ouster": (OUSTER, {"os_cloud_node/points": "/os_cloud_node/points"}),
    "velodyne": (
        {POINTS: "/velodyne_points", "velodyne_msgs/VelodyneScan": "/velodyne_packets"},
        {"velodyne/points": "/velodyne_points"},
    ),
    "other lidars": (
        {POINTS: "/scan_points /livox/lidar /move_base/voxel_cloud /octomap_point_cloud_centers"},
        {"scan/points": "/scan_points", "lidar/points": "/livox/lidar"},
    ),
    "turtlebot": (
        TURTLEBOT,
        {
            "tf": "/tf",
            "tf_static": "/tf_static",
            "camera/color": "/camera/rgb/image_raw",
            "camera/info": "/camera/rgb/camera_info",
        },
    ),
    "raspicam": (
        {COMPRESSED: "/raspicam_node/image/compressed", INFO: "/raspicam_node/camera_info"},
        {"raspicam_node/color": "/raspicam_node/image/compressed", "raspicam_node/info": "/raspicam_node/camera_info"},
    ),
    "usb_cam": (
        {IMAGE: "/usb_cam/image_raw", INFO: "/usb_cam/camera_info"},
        {"usb_cam/color": "/usb_cam/image_raw", "usb_cam/info": "/usb_cam/camera_info"},
    ),
    "a plain camera": ({IMAGE: "/camera/image_raw"}, {"camera/color": "/camera/image_raw"}),
    "the guide": (
        {IMAGE: "/camera/color/image_raw /camera/depth/image_raw", POINTS: "/camera/depth/points"},
        {
            "camera/color": "/camera/color/image_raw",
            "camera/depth": "/camera/depth/image_raw",
            "camera/points": "/camera/depth/points",
        },
    ),
    "two cameras": (
        {IMAGE: "/front/color/image_raw /rear/rgb/image_color /front/depth/image_raw", POINTS: "/front/depth/points"},
        {
            "front/color": "/front/color/image_raw",
            "front/depth": "/front/depth/image_raw",
            "front/points": "/front/depth/points",
            "rear/color": "/rear/rgb/image_color",
        },
    ),
    "in the robot's namespace": (
        {IMAGE: "/r1/front/color/image_raw /r1/rear/color/image_raw", TF: "/r1/tf"},
        {"tf": "/r1/tf", "front/color": "/r1/front/color/image_raw", "rear/color": "/r1/rear/color/image_raw"},
    ),
    "in another namespace": (
        {IMAGE: "/sensors/front/image_raw /sensors/rear/image_raw"},
        {"front/color": "/sensors/front/image_raw", "rear/color": "/sensors/rear/image_raw"},
    ),
    "cameras called alike": (
        {IMAGE: "/front/camera/color/image_raw /rear/camera/color/image_raw"},
        {"front/color": "/front/camera/color/image_raw", "rear/color": "/rear/camera/color/image_raw"},
    ),
    "two sides with nothing in common": (
        {IMAGE: "/left/image_raw /right/image_raw"},
        {"left/color": "/left/image_raw", "right/color": "/right/image_raw"},
    ),
    "only infrared": (
        {IMAGE: "/camera/infra1/image_rect_raw /camera/infra2/image_rect_raw"},
        {"camera/color": "/camera/infra1/image_rect_raw"},
    ),
    "only grey": ({IMAGE: "/camera/image_mono /camera/image_rect"}, {"camera/color": "/camera/image_rect"}),
    "compressed depth alone": (
        {COMPRESSED: "/front/depth/image_raw/compressedDepth /front/depth/image_raw/compressed"},
        {"front/depth": "/front/depth/image_raw/compressedDepth"},
    ),
    "compressed depth of colour": ({COMPRESSED: "/front/color/image_raw/compressedDepth"}, {}),
    "names without namespaces": (
        {IMAGE: "/camera1 /front_image_raw /rear_color /rear_depth/image_raw"},
        {
            "camera1/color": "/camera1",
            "front/color": "/front_image_raw",
            "rear/color": "/rear_color",
            "rear/depth": "/rear_depth/image_raw",
        },
    ),
    "made of images": ({IMAGE: "/apriltag/tag_detections_image /tracker/debug/image_raw /ultralytics/seen/image"}, {}),
    "reserved": ({IMAGE: "/status/image_raw"}, {"status_camera/color": "/status/image_raw"}),
}
"""By driver or case: what is published, and what robot r1 makes of it."""
