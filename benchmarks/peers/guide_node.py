"""Nodes of the guide, in our words: a rospy callback, a call of the model for each output. Arguments: weights, nodes.

    images    two annotated images, of a call each, while somebody subscribes to them
    classes   the names of what is in view, while somebody subscribes to them
    distance  of each depth image with the next colour image: the mean in each mask, sent as its author meant it to be
    cloud     of each coloured cloud: the points of each object, up to where they would be shown; then how many, as text

It differs from the guide where that would not run, or would see something else than fleetsight: pictures reach the
model as BGR, which it expects; the node that calls it twice has one model for both; nothing is shown. Nodes have names
of their own: under the guide's, each would end the one before.
"""

import sys
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import rospy
from sensor_msgs.msg import Image, PointCloud2
from std_msgs.msg import String
from ultralytics.models import YOLO

from benchmarks.guide.arrays import layout, pixels
from benchmarks.guide.topics import CLASSES, COLOR, DEPTH, DETECTION, DISTANCE, OBJECTS_SHOWN, POINTS, SEGMENTATION
from benchmarks.space import guide

QUEUE: Final = 5


def picture(message: Any) -> Any:
    """Return a colour image's pixels in BGR."""
    return pixels(message.data, message.encoding, message.height, message.width)[..., ::-1]


def annotated(plotted: Any) -> Any:
    """Return a picture that was drawn on as a message; like the guide's it has no stamp."""
    height, width = plotted.shape[:2]
    return Image(height=height, width=width, encoding="bgr8", step=width * 3, data=plotted.tobytes())


def names_of(result: Any) -> list[str]:
    """Return the name of each object."""
    return [result.names[int(number)] for number in result.boxes.cls.cpu().numpy()]


def masks_of(result: Any) -> Any:
    """Return the masks, objects x height x width."""
    return np.empty((0, 0, 0), np.float32) if result.masks is None else result.masks.data.cpu().numpy()


def images(model: Any) -> None:
    """Publish both annotated images."""
    detection = rospy.Publisher(DETECTION, Image, queue_size=QUEUE)
    segmentation = rospy.Publisher(SEGMENTATION, Image, queue_size=QUEUE)

    def on_image(message: Any) -> None:
        array = picture(message)
        if detection.get_num_connections():
            detection.publish(annotated(model(array)[0].plot(masks=False)))
        if segmentation.get_num_connections():
            segmentation.publish(annotated(model(array)[0].plot()))

    rospy.Subscriber(COLOR, Image, on_image)


def classes(model: Any) -> None:
    """Publish the names of what is in view."""
    publisher = rospy.Publisher(CLASSES, String, queue_size=QUEUE)

    def on_image(message: Any) -> None:
        if publisher.get_num_connections():
            publisher.publish(String(data=str(names_of(model(picture(message))[0]))))

    rospy.Subscriber(COLOR, Image, on_image)


def distance(model: Any) -> None:
    """Publish each object's mean distance."""
    publisher = rospy.Publisher(DISTANCE, String, queue_size=QUEUE)

    def on_depth(message: Any) -> None:
        image = rospy.wait_for_message(COLOR, Image)
        depth = pixels(message.data, message.encoding, message.height, message.width)
        result = model(picture(image))[0]
        means = guide.distances(masks_of(result), depth)
        objects = [f"{name}: {mean:.2f}" for name, mean in zip(names_of(result), means, strict=True)]
        publisher.publish(String(data=str(objects)))

    rospy.Subscriber(DEPTH, Image, on_depth)


def cloud(model: Any) -> None:
    """Cut each object out of the cloud."""
    publisher = rospy.Publisher(OBJECTS_SHOWN, String, queue_size=QUEUE)

    def on_points(message: Any) -> None:
        records = memoryview(message.data)
        kind = layout(message.fields, message.point_step)
        xyz, rgb = guide.read_cloud(records, kind, message.height, message.width)
        result = model(rgb)[0]
        shown = sum(1 for _ in guide.clouds(masks_of(result), xyz, rgb))
        publisher.publish(String(data=str(shown)))

    rospy.Subscriber(POINTS, PointCloud2, on_points)


NODES: Final[dict[str, Callable[[Any], None]]] = {
    "images": images,
    "classes": classes,
    "distance": distance,
    "cloud": cloud,
}


if __name__ == "__main__":
    weights, *nodes = sys.argv[1:]
    rospy.init_node("_".join(["ultralytics", *nodes]))
    for node in nodes:
        NODES[node](YOLO(weights))
    rospy.spin()
