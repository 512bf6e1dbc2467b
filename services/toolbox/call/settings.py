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

    robot: Annotated[str, Field(description="the robot's name; the first argument if no option is")]
    service: Annotated[str, Field(description="the service's whole name, like /reset; the second argument")]
    data: Annotated[
        Literal["true", "false"] | None, Field(description="what a std_srvs/SetBool is told; needed for it")
    ] = None
    timeout_s: Annotated[float, Field(gt=0, le=MAX_CALL_S, description="seconds that the service may take")] = 5.0

    @model_validator(mode="after")
    def _names_a_service(self) -> Self:
        try:
            keys.service(self.robot, self.service)
        except SchemaError as error:
            raise ValueError(str(error)) from error
        return self
