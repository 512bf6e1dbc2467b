import pytest

import bus
from fleetsight import errors
from fleetsight.errors import translated
from schemas.errors import SchemaError


@pytest.mark.parametrize(
    ("raised", "kind", "said"),
    [
        (bus.BusClosedError("x"), errors.ClosedError, "a thing: the fleet was left before; do it within `async with`"),
        (bus.NotServedError("nobody"), errors.NoWorkerError, "a thing: nobody; start one"),
        (bus.RequestTimeoutError("no answer"), errors.AnswerTimeoutError, "a thing: no answer; give it more time"),
        (bus.RefusedError("busy"), errors.RefusedError, "a thing: busy"),
        (bus.BusError("a bad key"), errors.FleetsightError, "a thing: a bad key"),
        (SchemaError("another version"), errors.MessageError, "a thing: another version"),
    ],
    ids=lambda each: type(each).__name__ if isinstance(each, Exception) else "",
)
def test_what_the_bus_and_the_contract_raise_is_ours_with_its_cause(
    raised: Exception, kind: type[Exception], said: str
) -> None:
    with pytest.raises(errors.FleetsightError) as caught:
        _raise(raised)
    assert (type(caught.value), str(caught.value)) == (kind, said)
    assert caught.value.__cause__ is raised


def _raise(error: Exception) -> None:
    with translated("a thing", absent=errors.NoWorkerError, cure="start one"):
        raise error


def test_what_the_program_raises_is_left_as_it_is() -> None:
    with pytest.raises(KeyError, match="mine"):
        _raise(KeyError("mine"))
