"""Settings of `fleetsight users`."""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, Field, ValidationInfo, model_validator

from services.monitor.history.settings import HistoryUrl, default_url
from services.monitor.web.auth.users import Role
from services.option_names import given_as_options


class UsersSettings(BaseModel):
    """Manage the users of a monitor. Passwords are prompted for, or read from standard input.

    `reset` gives another password or role and ends every session and token of theirs, as `remove` does; `token` prints
    a token for a program that does what this user may. A running monitor knows within seconds. Only `add` makes a
    database where there is none.
    """

    task: Annotated[Literal["add", "reset", "remove", "list", "token"], Field(description="what to do")]
    name: Annotated[str, Field(description="the user")] = ""
    role: Annotated[
        Role | None,
        Field(description="viewer: may only read; operator: may also act on alerts and robots (default: viewer)"),
    ] = None
    days: Annotated[float, Field(gt=0, le=3_650, description="days for which a token is valid")] = 365
    history: Annotated[
        HistoryUrl, Field(description="history database of the monitor; none if it keeps no history")
    ] = Field(default_factory=default_url)

    @model_validator(mode="after")
    def _gives_a_role_to_somebody(self, info: ValidationInfo) -> Self:
        if self.role is not None and "role" in given_as_options(self, info) and self.task not in {"add", "reset"}:
            raise ValueError(f"{self.task} takes no --role; only add and reset do")
        return self

    @model_validator(mode="after")
    def _gives_days_to_a_token(self, info: ValidationInfo) -> Self:
        if "days" in given_as_options(self, info) and self.task != "token":
            raise ValueError(f"{self.task} takes no --days; only token does")
        return self
