"""Several vehicles: which process gets what, and that one's end is not another's."""

from __future__ import annotations

import contextlib
import hashlib
import os
import signal
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.serve.fleet import Fleet, VehicleOptions, vehicles
from gcs_plugin.serve.hub import Hub
from mission.errors import LinkError, SettingsError
from mission.vehicle.mavlink.framing import decode, frames
from mission.vehicle.pilot.loopback import loopback_socket

LINKS = ["udpin://0.0.0.0:14540", "udpin://0.0.0.0:14541"]
WORKER = """
import sys, time
print("started", *sys.argv[1:], flush=True)
{then}
"""


def until(condition: Callable[[], object], timeout_s: float = 20.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)  # looks again until the deadline
    return bool(condition())


def test_one_vehicle_needs_nothing() -> None:
    assert vehicles([], [], [], [], [], None) == [VehicleOptions()]


def test_each_vehicle_gets_its_own_of_what_is_given_for_each_and_all_of_what_is_given_once(tmp_path: Path) -> None:
    found = vehicles([], LINKS, [], ["udp://:1", "udp://:2"], [tmp_path / "camera.toml"], None)
    assert [v.link for v in found] == LINKS
    assert [v.video for v in found] == ["udp://:1", "udp://:2"]
    assert {v.camera for v in found} == {tmp_path / "camera.toml"}


def test_vehicles_that_would_share_a_folder_get_one_each() -> None:
    folders = [v.folder for v in vehicles([], LINKS, [], [], [], None)]
    assert folders == [Path("flights/vehicle-1"), Path("flights/vehicle-2")]


def test_vehicles_with_folders_of_their_own_keep_them(tmp_path: Path) -> None:
    files = []
    for i in (1, 2):
        path = tmp_path / f"{i}.toml"
        path.write_text(f'[link]\nurl = "udpin://0.0.0.0:1454{i}"\n[answer]\nfolder = "flights-{i}"\n')
        files.append(path)
    assert [v.folder for v in vehicles(files, [], [], [], [], None)] == [None, None]


@pytest.mark.parametrize(
    ("links", "systems", "videos"),
    [
        (LINKS, [], ["a", "b", "c"]),
        (LINKS, [1, 2, 3], []),
        ([LINKS[0], LINKS[0]], [], []),
        ([LINKS[0]], [1, 1], []),
    ],
)
def test_options_that_do_not_fit_together_are_refused(links: list[str], systems: list[int], videos: list[str]) -> None:
    with pytest.raises(SettingsError):
        vehicles([], links, systems, videos, [], None)


def test_options_stand_above_the_settings_file(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text('[link]\nurl = "udpin://0.0.0.0:1"\n[video]\nurl = "udp://:9"\n')
    read = VehicleOptions(settings=path, link=LINKS[0], system=7).read()
    assert (read.link.url, read.link.system, read.video.url) == (LINKS[0], 7, "udp://:9")


def running(script: str, folder: Path, act: Callable[[Fleet, list[str]], None]) -> list[str]:
    """A fleet of two whose processes run a script; what it said."""
    path = folder / "worker.py"
    path.write_text(WORKER.format(then=script))
    said: list[str] = []
    fleet = Fleet(vehicles([], LINKS, [], [], [], folder), said.append, (sys.executable, str(path)), 0.1)
    over: list[bool] = []
    thread = Thread(target=fleet.run, args=(lambda: bool(over),))
    thread.start()
    try:
        act(fleet, said)
    finally:
        over.append(True)
        thread.join()
    return said


def test_each_vehicle_has_a_process_with_its_own_options(tmp_path: Path) -> None:
    def act(fleet: Fleet, said: list[str]) -> None:
        assert until(lambda: len(said) == 2)
        assert None not in fleet.pids
        assert len(set(fleet.pids)) == 2

    said = running("time.sleep(600)", tmp_path, act)
    assert sorted(said) == [
        f"[vehicle {i}] started --link {link} --folder {tmp_path / f'vehicle-{i}'}" for i, link in enumerate(LINKS, 1)
    ]


def test_one_that_is_killed_starts_again_and_the_other_never_notices(tmp_path: Path) -> None:
    def act(fleet: Fleet, said: list[str]) -> None:
        assert until(lambda: len(said) == 2)
        first, second = fleet.pids
        assert first is not None
        os.kill(first, signal.SIGKILL)
        assert until(lambda: sum("[vehicle 1] started" in line for line in said) == 2)
        assert fleet.pids[1] == second

    said = running("time.sleep(600)", tmp_path, act)
    assert sum("[vehicle 2]" in line for line in said) == 1
    assert any("vehicle 1] failed (-9), starting again" in line for line in said)


def test_one_whose_settings_are_wrong_is_not_tried_again(tmp_path: Path) -> None:
    def act(fleet: Fleet, said: list[str]) -> None:
        assert until(lambda: sum("is over" in line for line in said) == 2)

    running("sys.exit(2)", tmp_path, act)


def receive(sock: socket.socket) -> set[tuple[int, str]]:
    sock.settimeout(0.1)
    found = set()
    try:
        while True:
            for _, frame in frames(sock.recv(65535)):
                message = decode(mavlink.MAVLink(None), frame)
                if message is not None:
                    found.add((message.get_srcSystem(), message.get_type()))
    except TimeoutError:
        return found


def test_a_hub_passes_everything_on_to_each_and_back() -> None:
    outside, first, second = loopback_socket(), loopback_socket(), loopback_socket()
    probe = loopback_socket()
    port = probe.getsockname()[1]
    probe.close()
    hub = Hub(f"udpin://127.0.0.1:{port}", [s.getsockname()[1] for s in (first, second)])
    try:
        seen: dict[str, set[tuple[int, str]]] = {"first": set(), "second": set(), "outside": set()}
        beat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
        text = mavlink.MAVLink_statustext_message(6, b"back")

        def passed() -> bool:
            outside.sendto(beat.pack(mavlink.MAVLink(None, 7, 1)), ("127.0.0.1", port))
            for name, sock in (("first", first), ("second", second), ("outside", outside)):
                seen[name] |= receive(sock)
            if hub_address:
                first.sendto(text.pack(mavlink.MAVLink(None, 8, 100)), hub_address[0])
            else:
                first.settimeout(0.2)
                with contextlib.suppress(TimeoutError):
                    hub_address.append(first.recvfrom(65535)[1])
            return (7, "HEARTBEAT") in seen["first"] & seen["second"] and (8, "STATUSTEXT") in seen["outside"]

        hub_address: list[tuple[str, int]] = []
        assert until(passed)
    finally:
        hub.close()
        for sock in (outside, first, second):
            sock.close()


def test_a_hub_that_cannot_open_its_link_says_so() -> None:
    with pytest.raises(LinkError, match="cannot open"):
        Hub("serial:///dev/no-such-device:57600", [14599])


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="the list of processes is read from /proc")
def test_a_videos_password_is_in_no_list_of_processes_and_still_reaches_the_vehicles_process(tmp_path: Path) -> None:
    script = tmp_path / "worker.py"
    script.write_text(
        "import hashlib, sys, time\n"
        "print(hashlib.sha256(sys.stdin.readline().strip().encode()).hexdigest(), *sys.argv[1:], flush=True)\n"
        "time.sleep(600)\n"
    )
    video = "rtsp://pilot:s3cr3t@camera/live"
    said: list[str] = []
    fleet = Fleet(vehicles([], LINKS, [], [video], [], tmp_path), said.append, (sys.executable, str(script)), 0.1)
    over: list[bool] = []
    thread = Thread(target=fleet.run, args=(lambda: bool(over),))
    thread.start()
    try:
        assert until(lambda: len(said) == 2)
        shown = [Path(f"/proc/{pid}/cmdline").read_bytes() for pid in fleet.pids]
    finally:
        over.append(True)
        thread.join()
    assert not any(b"s3cr3t" in line for line in shown)
    assert all(hashlib.sha256(video.encode()).hexdigest() in line and "--video -" in line for line in said)
