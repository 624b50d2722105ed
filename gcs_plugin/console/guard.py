"""The door of the console: every request's host, origin and cookie are looked at before anything else is done."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs_plugin.console.access import COOKIE, Access, host_allowed, origin_allowed

_SAFE: Final = ("GET", "HEAD")
_OPEN: Final = ("/", "/login")
"""Paths that need no session; files of the page need none either: they are the same for everybody."""
_POLICY: Final = (
    "default-src 'self'; script-src 'self'; worker-src 'self' blob:; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
_HEADERS: Final = (
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


class Guard:
    """ASGI middleware. It puts the session, or None, into ``scope["state"]["session"]``.

    Args:
        app: what is behind the door.
        access: the sessions.
        hosts: names and addresses that this server answers to.
        tls: whether the connection is encrypted.
        files: paths of the page's own files.
    """

    def __init__(
        self, app: ASGIApp, access: Access, hosts: Collection[str], *, tls: bool, files: Collection[str]
    ) -> None:
        self._app = app
        self._access = access
        self._hosts = hosts
        self._scheme = "https" if tls else "http"
        self._files = files

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or answer it here."""
        if scope["type"] not in ("http", "websocket"):
            return
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not host_allowed(host, self._hosts):
            await self._refuse(scope, receive, send, 421, "This server does not answer to that name.")
            return
        socket = scope["type"] == "websocket"
        if (socket or scope["method"] not in _SAFE) and not origin_allowed(headers.get("origin"), self._scheme, host):
            await self._refuse(scope, receive, send, 403, "Only the console's own page may do this.")
            return
        session = self._access.session(cookie_of(headers.get("cookie", "")), caller_of(scope, headers))
        if session is None and (socket or scope["path"] not in (*_OPEN, *self._files)):
            await self._refuse(scope, receive, send, 401, "Log in first.")
            return
        scope.setdefault("state", {})["session"] = session

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        await self._app(scope, receive, sent)

    async def _refuse(self, scope: Scope, receive: Receive, send: Send, status: int, text: str) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
            return
        response: Response = PlainTextResponse(text, status)
        await response(scope, receive, send)


def cookie_of(header: str) -> str:
    """Our cookie's value in a Cookie header; empty when it is not there."""
    for part in header.split(";"):
        name, _, value = part.strip().partition("=")
        if name == COOKIE:
            return value
    return ""


def caller_of(scope: Scope, headers: Headers) -> str:
    """Address and browser."""
    client = scope.get("client")
    return f"{client[0] if client else ''} {headers.get('user-agent', '')[:200]}"
