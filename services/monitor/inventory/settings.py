"""Settings of the inventory."""

from typing import Annotated, ClassVar, Self

from pydantic import BaseModel, Field, model_validator

from services.monitor.inventory.debouncing import NS, Debounce
from services.monitor.inventory.inventory import Limits

Lists = Annotated[int, Field(ge=1, le=100)]
Seconds = Annotated[float, Field(ge=0, le=3600)]


class InventorySettings(BaseModel):
    """When what cameras see is believed."""

    heading: ClassVar = "what counts as seen"

    appear_lists: Annotated[Lists, Field(description="class lists in a row before a class, or more of it, counts")] = 2
    appear_s: Annotated[Seconds, Field(description="and for how many seconds")] = 0.0
    vanish_lists: Annotated[Lists, Field(description="class lists in a row without a class before it is gone")] = 2
    vanish_s: Annotated[Seconds, Field(description="and for how many seconds")] = 1.0
    stale_s: Annotated[float, Field(gt=0, le=3600, description="seconds without a list before a camera is stale")] = 3.0
    lost_s: Annotated[
        float, Field(gt=0, le=86400, description="seconds without a list before what was in view is not known any more")
    ] = 60.0

    @model_validator(mode="after")
    def _stale_before_lost(self) -> Self:
        if self.stale_s > self.lost_s:
            raise ValueError(f"stale_s {self.stale_s:g} is more than lost_s {self.lost_s:g}: a camera is stale first")
        return self

    def limits(self) -> Limits:
        """Return them as the inventory takes them."""
        debounce = Debounce(self.appear_lists, _ns(self.appear_s), self.vanish_lists, _ns(self.vanish_s))
        return Limits(debounce, stale_ns=_ns(self.stale_s), lost_ns=_ns(self.lost_s))


def _ns(seconds: float) -> int:
    return round(seconds * NS)
