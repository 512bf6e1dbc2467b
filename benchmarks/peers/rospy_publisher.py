"""Publishes 640x480 rgb8 images flat out with rospy. Runs under the Python that ROS is installed for."""

import rospy
from sensor_msgs.msg import Image

rospy.init_node("camera", anonymous=True, disable_signals=True)
publisher = rospy.Publisher(
    "/camera/color/image_raw", Image, queue_size=None
)  # None: publish() sends, so it paces itself
image = Image(height=480, width=640, encoding="rgb8", step=640 * 3, data=bytes(range(256)) * 3600)
while not rospy.is_shutdown():
    if publisher.get_num_connections():
        image.header.stamp = rospy.Time.now()
        publisher.publish(image)
    else:
        rospy.sleep(0.05)
