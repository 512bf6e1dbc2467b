import pytest
import zenoh

from bus.errors import BusError
from bus.session.panics import panics_are_errors


def test_a_panic_is_an_error_of_the_bus() -> None:
    config = zenoh.Config.from_json5('{"mode": "client", "connect": {"endpoints": ["tcp/127.0.0.1:1?rel=banana"]}}')
    with pytest.raises(BusError, match=r"Zenoh failed: .*banana") as caught, panics_are_errors():
        zenoh.open(config)
    assert not isinstance(caught.value.__cause__, Exception)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_anything_else_stays_what_it_is(error: type[BaseException]) -> None:
    with pytest.raises(error), panics_are_errors():
        raise error
