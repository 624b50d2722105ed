"""Several vehicles: a process for each, so that one's trouble is not another's, and this one that looks after them."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Final, TypeVar

from gcs_plugin.serve.hub import Hub
from mission.addresses import FROM_INPUT
from mission.errors import SettingsError
from mission.settings import MissionSettings, read_settings
from mission.vehicle.mavlink.url import mavsdk_url
from mission.vehicle.pilot.loopback import loopback_socket

AGAIN_S: Final = 2.0
"""A vehicle's process that failed is started again after this time, twice as long each time it fails soon again."""
LONGEST_S: Final = 60.0
_TURN_S: Final = 0.2
_END_S: Final = 20.0
Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class VehicleOptions:
    """What the command line says of one vehicle; None where the settings file decides."""

    settings: Path | None = None
    link: str | None = None
    system: int | None = None
    video: str | None = None
    camera: Path | None = None
    folder: Path | None = None

    def read(self) -> MissionSettings:
        """The settings with these options in them.

        Raises:
            SettingsError: the file is wrong.
        """
        settings = read_settings(self.settings)
        sections: dict[str, dict[str, object]] = {
            "link": {"url": self.link, "system": self.system},
            "video": {"url": self.video},
            "camera": {"file": self.camera},
            "answer": {"folder": self.folder},
        }
        changes = {
            name: getattr(settings, name).model_copy(update={k: v for k, v in values.items() if v is not None})
            for name, values in sections.items()
        }
        return settings.model_copy(update=changes)

    def arguments(self) -> list[str]:
        """For `sidestep serve`, which gets the video's address from standard input: it may hold a password."""
        pairs = (
            ("--settings", self.settings),
            ("--link", self.link),
            ("--system", self.system),
            ("--video", None if self.video is None else FROM_INPUT),
            ("--camera", self.camera),
            ("--folder", self.folder),
        )
        return [part for name, value in pairs if value is not None for part in (name, str(value))]


def vehicles(
    settings: Sequence[Path],
    links: Sequence[str],
    systems: Sequence[int],
    videos: Sequence[str],
    cameras: Sequence[Path],
    folder: Path | None,
) -> list[VehicleOptions]:
    """One for each vehicle: each option is given for none of them, once for all, or once for each, in the same order.

    Raises:
        SettingsError: the numbers of options do not fit together, or two vehicles share a link without system ids.
    """
    given = {"--settings": settings, "--link": links, "--system": systems, "--video": videos, "--camera": cameras}
    count = max(1, *(len(values) for values in given.values()))
    for name, values in given.items():
        if len(values) not in (0, 1, count):
            raise SettingsError(f"{name} is given {len(values)} times for {count} vehicles", "Give it once for each.")
    found = [
        VehicleOptions(_nth(settings, i), _nth(links, i), _nth(systems, i), _nth(videos, i), _nth(cameras, i), folder)
        for i in range(count)
    ]
    return found if count == 1 else _apart(found)


def _nth(values: Sequence[Value], index: int) -> Value | None:
    return (values[index] if len(values) > 1 else values[0]) if values else None


def _apart(found: list[VehicleOptions]) -> list[VehicleOptions]:
    """With folders of their own, where they would share one.

    Raises:
        SettingsError: two share a link, and it is not said which system each is.
    """
    read = [options.read() for options in found]
    keys = [(mavsdk_url(s.link.url), s.link.system) for s in read]
    for key in keys:
        shared = [other for other in keys if other[0] == key[0]]
        if len(shared) > 1 and (key[1] == 0 or shared.count(key) > 1):
            raise SettingsError(
                f"several vehicles are on {key[0]}, and their system ids are not told", "Give --system for each."
            )
    folders = [s.answer.folder.resolve() for s in read]
    return [
        replace(options, folder=settings.answer.folder / f"vehicle-{number}") if folders.count(path) > 1 else options
        for number, (options, settings, path) in enumerate(zip(found, read, folders, strict=True), start=1)
    ]


@dataclass(slots=True)
class _Member:
    name: str
    options: VehicleOptions
    process: subprocess.Popen[str] | None = None
    started_s: float = 0.0
    again_s: float = 0.0
    delay_s: float = 0.0
    over: bool = False


class Fleet:
    """Runs `sidestep serve` for each vehicle, and starts it again when it failed.

    Args:
        found: the vehicles.
        say: a line for the person at the terminal.
        command: starts `sidestep serve`; its arguments follow.
        again_s: from a failure to the first new start.
    """

    def __init__(
        self,
        found: Sequence[VehicleOptions],
        say: Callable[[str], None],
        command: Sequence[str] = (sys.executable, "-m", "gcs_plugin", "serve"),
        again_s: float = AGAIN_S,
    ) -> None:
        self._again_s = again_s
        self._say = say
        self._command = command
        self._hubs: list[Hub] = []
        self._members = [_Member(f"vehicle {i}", options) for i, options in enumerate(self._behind_hubs(found), 1)]

    def run(self, ended: Callable[[], bool]) -> None:
        """Look after them until the end of the program, or until none is left that could serve."""
        try:
            while not ended() and not all(member.over for member in self._members):
                for member in self._members:
                    self._look_after(member, time.monotonic())
                time.sleep(_TURN_S)  # looks again; a signal ends it at once
        finally:
            self._close()

    @property
    def pids(self) -> list[int | None]:
        """Process id of each vehicle's process; None for those that do not run."""
        running = (m.process for m in self._members)
        return [None if p is None or p.poll() is not None else p.pid for p in running]

    def _behind_hubs(self, found: Sequence[VehicleOptions]) -> list[VehicleOptions]:
        """Each link that several share is opened by a hub, and they listen behind it."""
        urls = [mavsdk_url(options.read().link.url) for options in found]
        result = list(found)
        for url in {u for u in urls if urls.count(u) > 1}:
            behind = [i for i, u in enumerate(urls) if u == url]
            ports = _free_ports(len(behind))
            self._hubs.append(Hub(url, ports))
            for i, port in zip(behind, ports, strict=True):
                system = found[i].read().link.system
                result[i] = replace(found[i], link=f"udpin://127.0.0.1:{port}", system=system)
        return result

    def _look_after(self, member: _Member, now_s: float) -> None:
        if member.over:
            return
        if member.process is not None:
            code = member.process.poll()
            if code is None:
                return
            member.process = None
            member.over = code in (0, 2)  # it ended in order, or its settings cannot be read
            soon = now_s - member.started_s < LONGEST_S
            member.delay_s = min(2.0 * member.delay_s, LONGEST_S) if soon and member.delay_s else self._again_s
            member.again_s = now_s + member.delay_s
            what = "is over" if member.over else f"failed ({code}), starting again in {member.delay_s:.0f} s"
            self._say(f"[{member.name}] {what}")
        elif now_s >= member.again_s:
            member.started_s = now_s
            member.process = subprocess.Popen(
                [*self._command, *member.options.arguments()],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,  # Ctrl-C comes from us, once
            )
            _hand_over(member.process.stdin, member.options.video)
            reader = threading.Thread(target=self._read, args=(member.name, member.process.stdout), daemon=True)
            reader.start()

    def _read(self, name: str, lines: IO[str] | None) -> None:
        for line in lines or ():
            self._say(f"[{name}] {line.rstrip()}")

    def _close(self) -> None:
        running = [m.process for m in self._members if m.process is not None]
        for process in running:
            process.terminate()
        for process in running:
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()  # its pilot process holds the vehicle
                process.wait()
        for hub in self._hubs:
            hub.close()


def _hand_over(pipe: IO[str] | None, video: str | None) -> None:
    if pipe is None:
        return
    with contextlib.suppress(BrokenPipeError), pipe:  # a process that has ended already is looked after
        if video is not None:
            pipe.write(f"{video}\n")


def _free_ports(count: int) -> list[int]:
    sockets = [loopback_socket() for _ in range(count)]
    ports = [int(sock.getsockname()[1]) for sock in sockets]
    for sock in sockets:
        sock.close()
    return ports
