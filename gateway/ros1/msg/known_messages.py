"""Definitions of the known message and service types, in ROS's .msg language."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from gateway.ros1.msg.definition import parse

if TYPE_CHECKING:
    from gateway.ros1.msg.definition import Definition, Definitions

_MESSAGES: Final = """\
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id

MSG: std_msgs/String
string data

MSG: std_msgs/ColorRGBA
float32 r
float32 g
float32 b
float32 a

MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z

MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w

MSG: geometry_msgs/Point
float64 x
float64 y
float64 z

MSG: geometry_msgs/Pose
Point position
Quaternion orientation

MSG: geometry_msgs/Transform
Vector3 translation
Quaternion rotation

MSG: geometry_msgs/TransformStamped
Header header
string child_frame_id
Transform transform

MSG: tf2_msgs/TFMessage
geometry_msgs/TransformStamped[] transforms

MSG: tf/tfMessage
geometry_msgs/TransformStamped[] transforms

MSG: sensor_msgs/Image
Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data

MSG: sensor_msgs/CompressedImage
Header header
string format
uint8[] data

MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify

MSG: sensor_msgs/CameraInfo
Header header
uint32 height
uint32 width
string distortion_model
float64[] D
float64[9] K
float64[9] R
float64[12] P
uint32 binning_x
uint32 binning_y
RegionOfInterest roi

MSG: sensor_msgs/PointField
uint8 INT8=1
uint8 UINT8=2
uint8 INT16=3
uint8 UINT16=4
uint8 INT32=5
uint8 UINT32=6
uint8 FLOAT32=7
uint8 FLOAT64=8
string name
uint32 offset
uint8 datatype
uint32 count

MSG: sensor_msgs/PointCloud2
Header header
uint32 height
uint32 width
PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] data
bool is_dense

MSG: stereo_msgs/DisparityImage
Header header
sensor_msgs/Image image
float32 f
float32 T
sensor_msgs/RegionOfInterest valid_window
float32 min_disparity
float32 max_disparity
float32 delta_d

MSG: visualization_msgs/Marker
uint8 ARROW=0
uint8 CUBE=1
uint8 SPHERE=2
uint8 CYLINDER=3
uint8 LINE_STRIP=4
uint8 LINE_LIST=5
uint8 CUBE_LIST=6
uint8 SPHERE_LIST=7
uint8 POINTS=8
uint8 TEXT_VIEW_FACING=9
uint8 MESH_RESOURCE=10
uint8 TRIANGLE_LIST=11
uint8 ADD=0
uint8 MODIFY=0
uint8 DELETE=2
uint8 DELETEALL=3
Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string text
string mesh_resource
bool mesh_use_embedded_materials

MSG: visualization_msgs/MarkerArray
visualization_msgs/Marker[] markers

MSG: rosgraph_msgs/Clock
time clock

MSG: rosgraph_msgs/Log
byte DEBUG=1
byte INFO=2
byte WARN=4
byte ERROR=8
byte FATAL=16
Header header
byte level
string name
string msg
string file
string function
uint32 line
string[] topics
"""

_SERVICES: Final = """\
MSG: std_srvs/EmptyRequest

MSG: std_srvs/EmptyResponse

MSG: std_srvs/TriggerRequest

MSG: std_srvs/TriggerResponse
bool success
string message

MSG: std_srvs/SetBoolRequest
bool data

MSG: std_srvs/SetBoolResponse
bool success
string message
"""

REQUEST: Final = "Request"
RESPONSE: Final = "Response"


def _parsed(text: str) -> dict[str, Definition]:
    named = (entry.partition("\n") for entry in text.removeprefix("MSG: ").split("\nMSG: "))
    return {name: parse(name, definition.strip()) for name, _, definition in named}


DEFINITIONS: Final[Definitions] = _parsed(_MESSAGES) | _parsed(_SERVICES)
"""Definitions by name; a service has two, its name followed by `Request` and by `Response`."""

SERVICES: Final = frozenset(name.removesuffix(REQUEST) for name in _parsed(_SERVICES) if name.endswith(REQUEST))
