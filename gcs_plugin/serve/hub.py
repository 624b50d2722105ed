"""One link shared by several vehicles' pilot processes: ``python -m gcs_plugin.serve.hub URL PORT...``.

A serial line or a UDP port can be opened once only, and each vehicle has a pilot process of its own. This process opens
it and passes everything on (MAVSDK's forwarding, MAVLink routing rules) to a loopback UDP port for each vehicle, and
back. It is a process of its own, and outlives its parent for a while: the pilot processes need it to put their vehicles
into hold when the parent is gone.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from mavsdk.enums import ForwardingOption
from mavsdk.exceptions import ConnectionError as MavsdkConnectionError
from mavsdk.mavsdk import Configuration, Mavsdk

import gcs_plugin
from mission.errors import LinkError

FAREWELL_S: Final = 8.0
"""Longer than a pilot process takes to put its vehicle into hold and end."""
_SYSTEM: Final = 245
_COMPONENT: Final = 240
"""MAV_COMP_ID_UDP_BRIDGE."""


class Hub:
    """The running process.

    Args:
        url: the link, as MAVSDK takes it.
        ports: loopback UDP ports on which the pilot processes listen.

    Raises:
        LinkError: the link cannot be opened.
    """

    def __init__(self, url: str, ports: list[int]) -> None:
        root = str(Path(gcs_plugin.__file__).parents[1])
        path = os.pathsep.join(p for p in (root, os.environ.get("PYTHONPATH", "")) if p)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "gcs_plugin.serve.hub", url, *map(str, ports)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C must not end it before the vehicles hold
        )
        answer = self._process.stdout.readline().strip() if self._process.stdout else ""
        if answer != "ready":
            self.close()
            raise LinkError(f"cannot open {url} ({answer or 'no answer'})", "Check the address and who else uses it.")

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    def close(self) -> None:
        """End it at once: the pilot processes have ended before. Safe to call twice."""
        self._process.terminate()
        self._process.wait(FAREWELL_S)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


def main(arguments: list[str]) -> int:
    """Pass on until the parent is gone, and a little longer."""
    url, ports = arguments[0], [int(port) for port in arguments[1:]]
    said = os.dup(1)
    os.dup2(2, 1)  # MAVSDK writes its log to 1
    mavsdk = Mavsdk(Configuration.create_manual(_SYSTEM, _COMPONENT, False))
    try:
        for address in (url, *(f"udpout://127.0.0.1:{port}" for port in ports)):
            mavsdk.add_any_connection_with_handle_and_forwarding(address, ForwardingOption.ON)
    except MavsdkConnectionError as error:
        os.write(said, f"{error}\n".encode())
        return 1
    os.write(said, b"ready\n")
    while os.read(0, 4096):  # ends when the parent does
        continue
    time.sleep(FAREWELL_S)  # the vehicles behind it hold and say so meanwhile
    mavsdk.destroy()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
