"""The console's server, in a thread of its own beside the vehicle's loop."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import uvicorn

from gcs_plugin.console.access import Access
from gcs_plugin.console.app import Place, application, page_files
from gcs_plugin.console.command import Command
from gcs_plugin.console.desk import ConsoleDesk
from gcs_plugin.console.passwords import read_passwords
from gcs_plugin.console.people import Lookout
from gcs_plugin.console.sockets import Room
from gcs_plugin.console.targets import TargetList
from mission.detect import Detector
from mission.errors import SettingsError
from mission.settings import ConsoleSettings

_MESSAGE_BYTES: Final = 8192
_HEADER_BYTES: Final = 16384
_CONNECTIONS: Final = 100
_CLOSE_S: Final = 3.0


class ConsoleServer:
    """Serves pages until it is closed.

    Args:
        settings: address, passwords, certificate, map.
        log: of the geotags.
        detector: makes a detector for people to tap.
        clock: the program's clock, seconds.

    Raises:
        SettingsError: the address cannot be used, or is open to others without password and TLS.
    """

    def __init__(
        self, settings: ConsoleSettings, log: Path, detector: Callable[[], Detector], clock: Callable[[], float]
    ) -> None:
        local = is_loopback(settings.host)
        tls = settings.certificate is not None and settings.key is not None
        if not local and (settings.password_file is None or not tls):
            raise SettingsError(
                f"the console at {settings.host} would be open to others without a password, or in clear text",
                "Set console.password_file, console.certificate and console.key, or leave console.host at 127.0.0.1.",
            )
        page = page_files()
        if "index.html" not in page:
            raise SettingsError(
                "the console's page is not built", "In gcs_plugin/console/web: npm ci && npm run build."
            )
        access = Access(read_passwords(settings.password_file), clock)
        self._socket = _bound(settings.host, settings.port)
        port = int(self._socket.getsockname()[1])
        names = {settings.host, *settings.hosts, *(("127.0.0.1", "localhost", "::1") if local else ())}
        targets = TargetList(log, clock)
        self.desk = ConsoleDesk(targets, clock)
        self._lookout = Lookout(self.desk.pictures, detector, lambda: self.desk.idle)
        room = Room(self.desk, self._lookout, Command(clock), clock)
        place = Place(frozenset(name.lower() for name in names), tls, settings.map)
        shown = f"[{settings.host}]" if ":" in settings.host else settings.host
        self.url = f"{'https' if tls else 'http'}://{shown}:{port}/"
        config = uvicorn.Config(
            application(room, access, place, page),
            ssl_certfile=None if settings.certificate is None else str(settings.certificate),
            ssl_keyfile=None if settings.key is None else str(settings.key),
            ws_max_size=_MESSAGE_BYTES,
            ws_max_queue=8,
            ws_ping_interval=5.0,
            ws_ping_timeout=10.0,
            ws_per_message_deflate=False,
            h11_max_incomplete_event_size=_HEADER_BYTES,
            limit_concurrency=_CONNECTIONS,
            timeout_keep_alive=5,
            timeout_graceful_shutdown=1,
            access_log=False,
            log_level="critical",
            server_header=False,
            lifespan="off",
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="console", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End. Safe to call twice."""
        self._server.should_exit = True
        self.desk.close()
        self._lookout.close()
        self._thread.join(_CLOSE_S)
        with contextlib.suppress(OSError):
            self._socket.close()

    def _run(self) -> None:
        self._server.run(sockets=[self._socket])


def is_loopback(host: str) -> bool:
    """Whether an address is reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _bound(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        made = socket.socket(family, kind, protocol)
    except OSError as error:
        raise SettingsError(f"the console cannot be at {host}: {error}", "Correct console.host.") from error
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
    except OSError as error:
        made.close()
        raise SettingsError(
            f"the console cannot be at {host}:{port}: {error.strerror}", "Choose another console.port."
        ) from error
    return made
