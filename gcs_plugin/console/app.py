"""The console's web application: the page's files, logging in, pictures and exports of targets, the pages' sockets."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from gcs_plugin.console.access import COOKIE, SESSION_S, Access, Session
from gcs_plugin.console.guard import Guard, caller_of
from gcs_plugin.console.sockets import MOST_PAGES, Page, Room
from gcs_plugin.exports.formats import FORMATS, format_of
from mission.errors import SidestepError

_TYPES: Final = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
    "json": "application/json",
    "txt": "text/plain; charset=utf-8",
}
_EXPORTS: Final = {
    "kmz": "application/vnd.google-earth.kmz",
    "gpx": "application/gpx+xml",
    "geojson": "application/geo+json",
    "csv": "text/csv; charset=utf-8",
    "gpkg": "application/geopackage+sqlite3",
    "zip": "application/zip",
}
_MOST_LOGIN_BYTES: Final = 2048


@dataclass(frozen=True, slots=True)
class Place:
    """How the console is reached."""

    hosts: frozenset[str]
    tls: bool
    map: Path | None = None
    """A PMTiles file that lies under everything."""


def page_files() -> Mapping[str, bytes]:
    """The built page by file name; empty in a source tree where it was not built."""
    folder = files("gcs_plugin.console").joinpath("page")
    if not folder.is_dir():
        return {}
    return {item.name: item.read_bytes() for item in folder.iterdir() if item.is_file()}


def application(room: Room, access: Access, place: Place, page: Mapping[str, bytes]) -> ASGIApp:
    """The application behind its guard.

    Args:
        room: what pages show.
        access: who may.
        place: how it is reached.
        page: the page's files, held in memory: no path of a request ever reaches the disk.
    """
    console = _Console(room, access, place, page)
    routes = [
        Route("/", console.index),
        Route("/login", console.login, methods=["POST"]),
        Route("/logout", console.logout, methods=["POST"]),
        Route("/map.pmtiles", console.map),
        Route("/targets/{number:int}/picture", console.picture),
        Route("/targets.{ending}", console.targets),
        Route("/{name}", console.file),
        WebSocketRoute("/live", console.live),
    ]
    known = [f"/{name}" for name in page if name != "index.html"]
    return Guard(Starlette(routes=routes), access, place.hosts, tls=place.tls, files=known)


class _Console:
    def __init__(self, room: Room, access: Access, place: Place, page: Mapping[str, bytes]) -> None:
        self._room = room
        self._access = access
        self._place = place
        self._page = page
        self._pages = 0

    async def index(self, request: Request) -> Response:
        """The page; a session begins here where no password is needed."""
        session: Session | None = request.state.session
        if session is None and self._access.password_needed:
            return _of(self._page, "login.html")
        response = _of(self._page, "index.html")
        if session is None:
            self._let_in(response, self._access.begin("commander", caller_of(request.scope, request.headers)))
        return response

    async def login(self, request: Request) -> Response:
        """A password, as the form's one field."""
        address = request.client.host if request.client else ""
        if not self._access.may_try(address):
            return HTMLResponse("Too many attempts: wait half a minute.", 429)
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > _MOST_LOGIN_BYTES:
                return HTMLResponse("That is no password.", 413)
        password = _field(body, "password")
        role = await asyncio.to_thread(self._access.role, password)
        if role is None:
            return RedirectResponse("/?wrong", 303)
        response = RedirectResponse("/", 303)
        self._let_in(response, self._access.begin(role, caller_of(request.scope, request.headers)))
        return response

    async def logout(self, request: Request) -> Response:
        """The session ends."""
        self._room.command.release(request.state.session.id)
        self._access.end(request.state.session)
        response = RedirectResponse("/", 303)
        response.delete_cookie(COOKIE)
        return response

    async def file(self, request: Request) -> Response:
        """A file of the page."""
        return _of(self._page, request.path_params["name"])

    async def map(self, request: Request) -> Response:
        """The user's map; the page asks for parts of it."""
        if self._place.map is None:
            return Response(status_code=404)
        return FileResponse(self._place.map, media_type="application/vnd.pmtiles")

    async def picture(self, request: Request) -> Response:
        """A target's picture."""
        number = request.path_params["number"]
        geotag = await asyncio.to_thread(self._room.desk.targets.find, number)
        if geotag is None or not geotag.picture:
            return Response(status_code=404)
        return Response(geotag.picture, media_type=geotag.picture_type)

    async def targets(self, request: Request) -> Response:
        """All targets as a file for another program."""
        ending = request.path_params["ending"]
        if ending not in _EXPORTS:
            return Response(status_code=404)
        geotags = await asyncio.to_thread(self._room.desk.targets.newest)
        try:
            content = await asyncio.to_thread(FORMATS[format_of(Path(f"targets.{ending}"))], geotags)
        except SidestepError as error:
            return JSONResponse({"error": str(error)}, 500)
        name = {"content-disposition": f'attachment; filename="targets.{ending}"'}
        return Response(content, media_type=_EXPORTS[ending], headers=name)

    async def live(self, socket: WebSocket) -> None:
        """A page's connection, for as long as it lasts."""
        if self._pages >= MOST_PAGES:
            await socket.close(1013)
            return
        self._pages += 1
        try:
            await socket.accept()
            await socket.send_text(json.dumps({"type": "map", "own": self._place.map is not None}))
            await Page(socket, socket.state.session, self._room).run()
        finally:
            self._pages -= 1

    def _let_in(self, response: Response, cookie: str) -> None:
        response.set_cookie(
            COOKIE, cookie, max_age=int(SESSION_S), httponly=True, samesite="strict", secure=self._place.tls, path="/"
        )


def _of(page: Mapping[str, bytes], name: str) -> Response:
    content = page.get(name)
    kind = _TYPES.get(name.rpartition(".")[2])
    if content is None or kind is None:
        return Response(status_code=404)
    return Response(content, media_type=kind, headers={"cache-control": "no-cache"})


def _field(body: bytes, name: str) -> str:
    try:
        return parse_qs(body.decode("utf-8"), max_num_fields=4).get(name, [""])[0]
    except ValueError:
        return ""
