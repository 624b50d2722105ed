"""Where events go: a UDP address (multicast or one device), or a TAK server over TCP or TLS.

Nothing here waits: what cannot be sent now is dropped, oldest first, since every event is sent again until it is stale.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import socket
import threading
import warnings
from collections import deque
from configparser import ConfigParser, SectionProxy
from typing import Any, Final, Protocol
from urllib.parse import urlsplit

from mission.errors import SettingsError
from mission.settings import TakSettings

_LOG = logging.getLogger(__name__)
_WAITING_EVENTS: Final = 200
_AGAIN_S: Final = 1.0
_LONGEST_AGAIN_S: Final = 30.0
_CLOSE_S: Final = 2.0
_DISCARD_BYTES: Final = 65536


class CotSender(Protocol):
    """Sends events to one address."""

    def send(self, event: bytes) -> None:
        """Send one whole event, without waiting; never raises for what the network does."""
        ...

    def close(self) -> None:
        """End. Safe to call twice."""
        ...


def cot_sender(url: str, settings: TakSettings) -> CotSender:
    """The sender for one of the addresses of the settings.

    Raises:
        SettingsError: the address cannot be used.
        ModuleNotFoundError: the extra [tak] is not installed, and the address is a server's.
    """
    parts = urlsplit(url)
    try:
        host, port = parts.hostname or "", parts.port or 0
    except ValueError as error:
        raise SettingsError(f"{url!r} is not an address for Cursor on Target", "Give udp://HOST:PORT.") from error
    if parts.scheme == "udp":
        return UdpSender(host, port, settings.interface)
    return ServerSender(url, settings)


class UdpSender:
    """Datagrams to a device or to a multicast group, one event each.

    Args:
        host: address or name; a multicast group reaches the local network only.
        port: of it.
        interface: address of the interface that multicasts go out of; empty for the system's choice.

    Raises:
        SettingsError: the host has no address, or the interface is none of this machine's.
    """

    def __init__(self, host: str, port: int, interface: str = "") -> None:
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise SettingsError(f"{host!r} is not known: {error}", "Correct tak.urls.") from error
        self._address = (str(address[0]), port)
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)
        self._failing = False
        if family == socket.AF_INET and ipaddress.ip_address(self._address[0]).is_multicast:
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
            if interface:
                try:
                    own = socket.inet_aton(interface)
                    self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
                except OSError as error:
                    self._socket.close()
                    raise SettingsError(
                        f"tak.interface {interface!r} is no interface's address", "`ip address` lists them."
                    ) from error

    def send(self, event: bytes) -> None:
        """Send a datagram."""
        try:
            self._socket.sendto(event, self._address)
            self._failing = False
        except OSError as error:  # no route at the moment, nobody listens, or closed
            if not self._failing:
                _LOG.warning("Cursor on Target to %s:%s: %s", *self._address, error)
            self._failing = True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class ServerSender:
    """A connection to a TAK server, made again whenever it is lost.

    Args:
        url: ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
        settings: certificates.

    Raises:
        ModuleNotFoundError: the extra [tak] is not installed.
    """

    def __init__(self, url: str, settings: TakSettings) -> None:
        with warnings.catch_warnings():  # of what enrolment would need
            warnings.simplefilter("ignore")
            import pytak

        self._pytak: Any = pytak
        self._url = url
        self._config = _pytak_section(url, settings)
        self._waiting: deque[bytes] = deque(maxlen=_WAITING_EVENTS)
        self._ended = False
        self._loop = asyncio.new_event_loop()
        self._news = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="tak-server", daemon=True)
        self._thread.start()

    def send(self, event: bytes) -> None:
        """Leave an event for the connection's thread."""
        self._waiting.append(event)
        self._wake()

    def close(self) -> None:
        """End the connection."""
        self._ended = True
        self._wake()
        self._thread.join(_CLOSE_S)

    def _wake(self) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._news.set)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        delay_s, told = _AGAIN_S, ""
        while not self._ended:
            try:
                reader, writer = await asyncio.wait_for(self._pytak.protocol_factory(self._config), 10.0)
            except (OSError, ValueError, SyntaxError, TimeoutError) as error:
                if str(error) != told:
                    told = str(error)
                    _LOG.warning("TAK server %s: %s", self._url, told or "no answer")
                await self._rest(delay_s)
                delay_s = min(2.0 * delay_s, _LONGEST_AGAIN_S)
                continue
            delay_s, told = _AGAIN_S, ""
            _LOG.info("TAK server %s: connected", self._url)
            listening = asyncio.ensure_future(_discard(reader))
            try:
                await self._pass_on(writer, listening)
            except OSError as error:
                _LOG.warning("TAK server %s: %s", self._url, error)
            finally:
                listening.cancel()
                writer.close()

    async def _pass_on(self, writer: asyncio.StreamWriter, listening: asyncio.Future[None]) -> None:
        """Until the end, or until the server closes the connection."""
        while not self._ended and not listening.done():
            self._news.clear()
            while self._waiting:
                writer.write(self._waiting.popleft())
                await asyncio.wait_for(writer.drain(), 10.0)
            news = asyncio.ensure_future(self._news.wait())
            either: set[asyncio.Future[Any]] = {news, listening}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            news.cancel()

    async def _rest(self, delay_s: float) -> None:
        end_s = self._loop.time() + delay_s
        while not self._ended and (left_s := end_s - self._loop.time()) > 0.0:
            self._news.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), left_s)


async def _discard(reader: asyncio.StreamReader) -> None:
    """Read what the server tells of others, so that it can go on sending, and forget it."""
    with contextlib.suppress(OSError):
        while await reader.read(_DISCARD_BYTES):
            pass


def _pytak_section(url: str, settings: TakSettings) -> SectionProxy:
    parser = ConfigParser(interpolation=None)
    values = {"COT_URL": url, "TAK_PROTO": "0"}
    names = {
        "PYTAK_TLS_CLIENT_CERT": settings.certificate,
        "PYTAK_TLS_CLIENT_KEY": settings.key,
        "PYTAK_TLS_CLIENT_CAFILE": settings.authority,
    }
    values.update({name: str(path) for name, path in names.items() if path is not None})
    parser["sidestep"] = values
    return parser["sidestep"]
