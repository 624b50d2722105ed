"""The vehicle's address as an operator writes it, checked and put into the form that MAVSDK takes."""

from __future__ import annotations

import re

from mission.errors import SettingsError

_EXAMPLES = (
    "Use one of udpin://0.0.0.0:14540 (listen), udpout://HOST:PORT, tcp://HOST:PORT, tcpin://0.0.0.0:PORT or"
    " serial:///dev/ttyACM0:57600"
)
_NET = re.compile(r"(?P<host>\[[0-9a-fA-F:]+\]|[A-Za-z0-9_.\-]*):(?P<port>\d+)$")
_SERIAL = re.compile(r"(?P<device>/[^:\s]+|[A-Za-z][A-Za-z0-9_.]*)(?::(?P<baud>\d+))?$")
_LISTEN_HOSTS = {"", "0.0.0.0", "localhost", "[::]"}


def mavsdk_url(url: str) -> str:
    """Checks an address and returns it as MAVSDK's `add_any_connection` takes it.

    `udp://` listens when its host is empty, 0.0.0.0 or this machine's loopback (as in MAVSDK's and pymavlink's older
    forms), and sends otherwise. `tcp://` and `tcpout://` connect to a server. A serial line without a baud rate has
    57600.

    Raises:
        SettingsError: not an address, a port outside 1 to 65535, or a scheme that is not known.
    """
    scheme, separator, rest = url.strip().partition("://")
    if not separator:
        raise SettingsError(f"{url!r} is not a vehicle address: it has no scheme", _EXAMPLES)
    scheme = scheme.lower()
    if scheme in ("serial", "serial_flowcontrol"):
        return f"{scheme}://{_serial(url, rest)}"
    if scheme not in ("udp", "udpin", "udpout", "tcp", "tcpin", "tcpout"):
        raise SettingsError(f"the vehicle address {url!r} has the unknown scheme {scheme!r}", _EXAMPLES)
    host, port = _host_and_port(url, rest)
    if scheme == "udp":
        scheme = "udpin" if host in _LISTEN_HOSTS or host.startswith("127.") else "udpout"
    elif scheme == "tcp":
        scheme = "tcpout"
    if scheme in ("udpin", "tcpin"):
        return f"{scheme}://{host or '0.0.0.0'}:{port}"
    if host in ("", "0.0.0.0", "[::]"):
        raise SettingsError(f"the vehicle address {url!r} names no host to connect to", _EXAMPLES)
    return f"{scheme}://{host}:{port}"


def _host_and_port(url: str, rest: str) -> tuple[str, int]:
    match = _NET.match(rest)
    if not match:
        raise SettingsError(f"the vehicle address {url!r} is not of the form HOST:PORT", _EXAMPLES)
    port = int(match["port"])
    if not 1 <= port <= 65535:
        raise SettingsError(f"the vehicle address {url!r} has the port {port}, outside 1 to 65535", _EXAMPLES)
    return match["host"], port


def _serial(url: str, rest: str) -> str:
    match = _SERIAL.match(rest)
    if not match:
        raise SettingsError(f"the vehicle address {url!r} is not of the form serial://DEVICE:BAUD", _EXAMPLES)
    baud = int(match["baud"] or 57600)
    if not 300 <= baud <= 12_000_000:
        cause = f"the vehicle address {url!r} has the baud rate {baud}, outside 300 to 12000000"
        raise SettingsError(cause, _EXAMPLES)
    return f"{match['device']}:{baud}"
