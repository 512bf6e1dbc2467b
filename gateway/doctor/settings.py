"""Settings of the doctor: the gateway's own, and time limits."""

from typing import Annotated

from pydantic import AfterValidator, ConfigDict, Field

from gateway.settings import GatewaySettings, robot_name
from schemas.keys import SensorKey


def _maybe_robot(name: str) -> str:
    return robot_name(name) if name else name


class DoctorSettings(GatewaySettings):
    """Say in plain words why nothing flows, and what to do about it. Run it on the robot, with the gateway's options.

    It looks for some seconds, next to the running gateway or without one, and ends with exit code 0 when all is well, 1
    when something keeps data from flowing or makes it wrong. It changes nothing and wants nothing: the robot's topics
    are listened to on ROS for these seconds, and no stream is subscribed to on Zenoh. Without --robot it lists the
    fleet's robots, from wherever Zenoh can be joined, and looks at no ROS graph.
    """

    robot: Annotated[
        str,
        AfterValidator(_maybe_robot),
        Field(description="the robot to examine; without one, the state of all gateways of the fleet"),
    ] = ""

    model_config = ConfigDict(validate_by_name=True, validate_by_alias=True)

    seconds: Annotated[float, Field(ge=0.5, le=60, description="how long to listen to topics and to the gateway")] = 3.0
    patience_s: Annotated[float, Field(ge=0.1, le=10, description="how long to wait for any answer")] = 1.5
    as_json: Annotated[bool, Field(alias="json", description="print one JSON object instead of text")] = False

    def streams(self) -> dict[SensorKey, str]:
        """Return the topic of every named stream; none without a robot."""
        return super().streams() if self.robot else {}
