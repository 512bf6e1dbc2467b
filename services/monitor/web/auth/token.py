"""How programs log in, for the API's description."""

from fastapi.openapi.models import HTTPBearer
from fastapi.security.base import SecurityBase


class Token(SecurityBase):
    """Is in the description of every call that depends on it."""

    def __init__(self) -> None:
        self.model = HTTPBearer(description="What `fleetsight users token NAME` prints.")
        self.scheme_name = "token"

    async def __call__(self) -> None:
        """Look at nothing: `AccessMiddleware` has seen who asks."""
