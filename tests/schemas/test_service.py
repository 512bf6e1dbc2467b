import pytest

from schemas.errors import SchemaError
from schemas.ros import ServiceRequest


def test_a_service_is_given_one_thing() -> None:
    with pytest.raises(SchemaError, match="not both"):
        ServiceRequest(argument=False, data=b"", timeout_s=5)
