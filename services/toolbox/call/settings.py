"""Settings of a call."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bus.settings import BusSettings
from schemas import keys
from schemas.errors import SchemaError
from schemas.ros import MAX_CALL_S


class CallSettings(BusSettings):
    """Call a ROS service of a robot, which its gateway must list (`--services` there).

    Services of std_srvs are meant: Empty, Trigger, and SetBool with --data. Prints what the service answers. Exit code
    1 and one line say why there is no answer, or that the service did not succeed.
    """

    robot: Annotated[str, Field(description="name of the robot; also the first argument")]
    service: Annotated[str, Field(description="full name of the service, such as /reset; also the second argument")]
    data: Annotated[
        Literal["true", "false"] | None, Field(description="value for a std_srvs/SetBool service, which requires it")
    ] = None
    timeout_s: Annotated[float, Field(gt=0, le=MAX_CALL_S, description="seconds to wait for the service")] = 5.0

    @model_validator(mode="after")
    def _names_a_service(self) -> Self:
        try:
            keys.service(self.robot, self.service)
        except SchemaError as error:
            raise ValueError(str(error)) from error
        return self
