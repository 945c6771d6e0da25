"""What happens to every request: an id of its own, and a limit on its body."""

import re
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from adret_service.ids import new_id
from adret_service.problems import FieldError, Problem, render, too_large

__all__ = ["BodyLimit", "RequestId", "SameOrigin"]

_GIVEN = re.compile(r"[\w.-]{1,64}", re.ASCII)


class RequestId:
    """Gives each request an id, or keeps a plain one from the client, and sends it back."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        given = Headers(scope=scope).get("x-request-id", "")
        request_id = given if _GIVEN.fullmatch(given) else new_id()
        scope["request_id"] = request_id

        async def send_with_id(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message)["X-Request-ID"] = request_id
            await send(message)

        await self.app(scope, receive, send_with_id)


class SameOrigin:
    """Refuses changes that a web page of another origin asks a visitor's browser to make."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD", "OPTIONS"):
            headers = Headers(scope=scope)
            origin = headers.get("origin")
            if origin is not None and urlsplit(origin).netloc != headers.get("host"):
                error = FieldError("origin", "this service's own, or absent", origin)
                problem = Problem(403, str(error), errors=[error])
                await render(Request(scope), problem)(scope, receive, send)
                return
        await self.app(scope, receive, send)


class BodyLimit:
    """Refuses bodies above a limit while they arrive; uploads have their own limit.

    Parameters
    ----------
    app : ASGIApp
        What comes next.
    limit : int
        Largest body [bytes].
    exempt : str
        The path that has its own limit, and what is below it.
    """

    def __init__(self, app: ASGIApp, *, limit: int, exempt: str) -> None:
        self.app = app
        self.limit = limit
        self.exempt = exempt

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        exempt = scope["type"] != "http" or f"{scope['path']}/".startswith(f"{self.exempt}/")
        if exempt:
            await self.app(scope, receive, send)
            return
        declared = Headers(scope=scope).get("content-length", "")
        if declared.isdigit() and int(declared) > self.limit:
            problem = self._problem(int(declared))
            await render(Request(scope), problem)(scope, receive, send)
            return
        seen = 0

        async def counted() -> Message:
            nonlocal seen
            message = await receive()
            seen += len(message.get("body", b""))
            if seen > self.limit:
                raise self._problem(seen)
            return message

        await self.app(scope, counted, send)

    def _problem(self, size: int) -> Problem:
        return too_large("body", f"at most {self.limit} bytes", size)
