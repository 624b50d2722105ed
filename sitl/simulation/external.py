"""A user's own PX4 (SIH) or ArduPilot SITL binary in place of the simulated autopilot.

It flies itself; its true pose is read over MAVLink into the `TruthRing`, so that the camera and the scorer work as with
`sitl.autopilot`. PX4's SIH sends HIL_STATE_QUATERNION on a link of its own (UDP 19410 + instance, the display's port),
ArduPilot SIM_STATE on request. Both are asked for 50 Hz; positions come in 1e-7 degrees, about 1 cm.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import shutil
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.errors import LinkError, SettingsError
from sitl.aircraft.truth import TruthRing, VehicleTruth
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.local_frame import LocalFrame
from sitl.autopilot.rotation import NED_FROM_ENU, Quat, multiply

_log = logging.getLogger(__name__)
_HOST = "127.0.0.1"
_ASK_EVERY_S = 1.0
_TRUTH_HZ = 50.0
_FARTHEST_M = 1000.0
_PX4_INSTANCES = 10
_STOP_S = 3.0
ESTIMATOR_S = 90.0
"""ArduPilot needs some 35 s from its start until it accepts a take-off."""
_READER_SYSTEM = 246
_EKF_POSITION = 0x218
_WANTED_HZ: Mapping[str, Mapping[int, float]] = {
    "px4": {mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: _TRUTH_HZ},
    "ardupilot": {
        mavlink.MAVLINK_MSG_ID_SIM_STATE: _TRUTH_HZ,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    },
}

# What ArduPilot's own start script sets for a quad; without it the pre-arm checks fail.
_ARDUPILOT_DEFAULTS: Mapping[str, float] = {
    "FRAME_CLASS": 1,
    "FRAME_TYPE": 0,
    "FS_THR_ENABLE": 0,
    "SERIAL2_PROTOCOL": 2,
    "COMPASS_OFS_X": 5,
    "COMPASS_OFS_Y": 13,
    "COMPASS_OFS_Z": -18,
    **{f"INS_ACC{n}OFFS_{axis}": 0.001 for n in ("", "2") for axis in "XYZ"},
    **{f"INS_ACC{n}SCAL_{axis}": 1.001 for n in ("", "2") for axis in "XYZ"},
}


@dataclass(frozen=True, slots=True)
class Launch:
    """How a binary is started, and where its links are."""

    kind: Literal["px4", "ardupilot"]
    command: tuple[str, ...]
    environment: Mapping[str, str]
    url: str
    operator_url: str
    truth_port: int
    """UDP port on which the true pose arrives."""


class ExternalAutopilot:
    """A running binary; the same handle as `sitl.autopilot.AutopilotProcess` in pid, url, operator_url, stop."""

    def __init__(self, launch: Launch, config: AutopilotConfig, truth_name: str, timeout_s: float) -> None:
        self._launch = launch
        self._folder = tempfile.mkdtemp(prefix="sidestep-sitl-")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((_HOST, launch.truth_port))
        self._socket.settimeout(0.2)
        self._ring = TruthRing.attach(truth_name)
        self._place = LocalFrame(
            config.home.lat_deg, config.home.lon_deg, config.home_alt_amsl_m, config.geoid_separation_m
        )
        self._stopping = threading.Event()
        self._first = threading.Event()
        self._ready = threading.Event()
        """Position estimate and pre-arm checks are good (ArduPilot)."""
        self._estimates = self._passes = False
        self._far_m = 0.0
        if launch.kind == "ardupilot":
            defaults = {**_ARDUPILOT_DEFAULTS, **dict(config.parameters)}
            text = "".join(f"{name} {value:g}\n" for name, value in defaults.items())
            (Path(self._folder) / "defaults.parm").write_text(text)
        self._output = (Path(self._folder) / "output.txt").open("w+b")
        try:
            self._process = subprocess.Popen(
                launch.command,
                cwd=self._folder,
                env={**os.environ, **launch.environment},
                stdin=subprocess.DEVNULL,
                stdout=self._output,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C is for the program that flies it, not for the aircraft
            )
        except OSError as error:
            self._release()
            raise LinkError(
                f"{launch.command[0]} cannot be started: {error}", "use a build for this machine"
            ) from error
        self._reader = threading.Thread(target=self._read, name="external-truth", daemon=True)
        self._reader.start()
        self._await(timeout_s)

    def await_estimator(self, timeout_s: float = ESTIMATOR_S) -> None:
        """Wait until it would accept a take-off; PX4 is asked by the mission itself.

        Raises:
            LinkError: its estimator does not get ready, or it ended.
        """
        if self._launch.kind == "px4":
            return
        until = time.monotonic() + timeout_s
        while not self._ready.wait(0.1):
            self.check_alive()
            if time.monotonic() > until:
                name, said = Path(self._launch.command[0]).name, self._said()
                raise LinkError(
                    f"{name} has no position after {timeout_s:.0f} s; it said: {said}", "see its pre-arm checks"
                )

    def check_alive(self) -> None:
        """Notice a binary that died.

        Raises:
            LinkError: it did; with the last that it said.
        """
        status = self._process.poll()
        if status is not None and not self._stopping.is_set():
            name, said = Path(self._launch.command[0]).name, self._said()
            raise LinkError(f"{name} ended in flight (exit status {status}) and said: {said}", "start it by hand")

    def _said(self) -> str:
        return Path(self._folder, "output.txt").read_bytes()[-300:].decode(errors="replace").strip()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def url(self) -> str:
        """What the drone connects to."""
        return self._launch.url

    @property
    def operator_url(self) -> str:
        """Where another ground station connects to."""
        return self._launch.operator_url

    @property
    def alive(self) -> bool:
        """Whether it runs."""
        return self._process.poll() is None

    def stop(self) -> None:
        """End it and forget its files. Safe to call twice."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        self._process.terminate()
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._release()

    def _release(self) -> None:
        self._socket.close()
        self._output.close()
        self._ring.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _await(self, timeout_s: float) -> None:
        until = time.monotonic() + timeout_s
        while not self._first.wait(0.05):
            ended = self._process.poll() is not None
            if ended or time.monotonic() > until or self._far_m > 0.0:
                cause, remedy = self._why(ended)
                self.stop()
                raise LinkError(cause, remedy)

    def _why(self, ended: bool) -> tuple[str, str]:
        name = Path(self._launch.command[0]).name
        if self._far_m > 0.0:
            return (
                f"{name} started {self._far_m / 1000.0:.0f} km from the scenario's home",
                "PX4 before 1.16 takes PX4_HOME_LAT and PX4_HOME_LON in 1e-7 degrees: use a newer build",
            )
        said = self._said()
        if ended:
            return f"{name} ended at once and said: {said}", "start it by hand with the same arguments"
        return f"{name} runs but tells no true pose; it said: {said}", "use a SITL build (PX4: with SIH)"

    def _read(self) -> None:
        """Ask for the true pose and write what comes to the ring, until told to stop."""
        # Not as a ground station: an autopilot would take it for the operator.
        parser = mavlink.MAVLink(None, srcSystem=_READER_SYSTEM, srcComponent=mavlink.MAV_COMP_ID_USER1)
        parser.robust_parsing = True
        system, asked = 0, -math.inf
        peer: tuple[str, int] | None = None
        if self._launch.kind == "px4":
            peer = (_HOST, self._launch.truth_port + 40)  # 19450 + instance
        while not self._stopping.is_set():
            now = time.monotonic()
            if peer is not None and now - asked > _ASK_EVERY_S:
                asked = now
                self._ask(parser, system, peer)
            try:
                data, peer = self._socket.recvfrom(65536)
            except TimeoutError:
                continue
            except OSError as error:
                _log.debug("truth link: %s", error)
                continue
            arrived = time.monotonic()
            for message in _parsed(parser, data):
                system = message.get_srcSystem()
                truth = true_state(message, self._place, arrived)
                if truth is not None:
                    self._take(truth)
                self._note_health(message)

    def _ask(self, parser: Any, system: int, peer: tuple[str, int]) -> None:
        wanted = _WANTED_HZ[self._launch.kind]
        order, kind = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_TYPE_ONBOARD_CONTROLLER
        beat = mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
        asks = [
            mavlink.MAVLink_command_long_message(system, 0, order, 0, message_id, 1e6 / hz, 0, 0, 0, 0, 0)
            for message_id, hz in wanted.items()
        ]
        for message in (beat, *asks):
            with contextlib.suppress(OSError):  # not listening yet: asked again in a second
                self._socket.sendto(bytes(message.pack(parser)), peer)
            parser.seq = (parser.seq + 1) % 256

    def _note_health(self, message: Any) -> None:
        """ArduPilot's filter uses GPS for an absolute position, and its pre-arm checks pass."""
        if message.get_type() == "EKF_STATUS_REPORT":
            self._estimates = message.flags & _EKF_POSITION == _EKF_POSITION
        elif message.get_type() == "SYS_STATUS":
            self._passes = bool(message.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
        if self._estimates and self._passes:
            self._ready.set()

    def _take(self, truth: VehicleTruth) -> None:
        distance = float(np.linalg.norm(truth.position_enu_m))
        if not self._first.is_set() and distance > _FARTHEST_M:
            self._far_m = distance
            return
        self._ring.write(truth)
        self._first.set()


def start_external(
    autopilot: str, config: AutopilotConfig, truth_name: str, timeout_s: float = 30.0
) -> ExternalAutopilot:
    """Start `px4:PATH` or `ardupilot:PATH` and wait for its true pose.

    Args:
        autopilot: the kind and the path of the binary.
        config: home, heading and parameters are used; noise and wind are the binary's own.
        truth_name: of the ring that its true pose goes to.
        timeout_s: from the start to the first true pose.

    Raises:
        SettingsError: the text does not name a known kind and an executable file.
        LinkError: it ended, is silent, or flies somewhere else.
    """
    kind, _, text = autopilot.partition(":")
    path = Path(text).expanduser().absolute()
    if kind not in ("px4", "ardupilot") or not text:
        raise SettingsError(f"{autopilot!r} names no autopilot", "write px4:PATH or ardupilot:PATH")
    if not path.is_file() or not os.access(path, os.X_OK):
        raise SettingsError(f"{path} is not an executable file", "build it, or correct the path")
    launch = px4_launch(path, config) if kind == "px4" else ardupilot_launch(path, config)
    return ExternalAutopilot(launch, config, truth_name, timeout_s)


def px4_launch(path: Path, config: AutopilotConfig) -> Launch:
    """PX4's SIH quad: `px4 -i INSTANCE -d [etc]`; ports follow from the instance (px4-rc.mavlink).

    Raises:
        LinkError: ten instances run already.
    """
    ports = (14540, 14580, 18570, 19410, 19450)
    free = (n for n in range(_PX4_INSTANCES) if all(_is_free(port + n) for port in ports))
    instance = next(free, None)
    if instance is None:
        raise LinkError("no free PX4 instance", "stop the PX4 simulators that run")
    etc = path.parent.parent / "etc"
    command = (str(path), "-i", str(instance), "-d", *([str(etc)] if etc.is_dir() else []))
    environment = {
        "PX4_SIM_MODEL": "sihsim_quadx",
        "HEADLESS": "1",
        "PX4_HOME_LAT": f"{config.home.lat_deg:.7f}",
        "PX4_HOME_LON": f"{config.home.lon_deg:.7f}",
        "PX4_HOME_ALT": f"{config.home_alt_amsl_m:.3f}",
        **{f"PX4_PARAM_{name}": f"{value:g}" for name, value in config.parameters},
    }
    url, operator = f"udpin://{_HOST}:{14540 + instance}", f"udpout://{_HOST}:{18570 + instance}"
    return Launch("px4", command, environment, url, operator, 19410 + instance)


def ardupilot_launch(path: Path, config: AutopilotConfig) -> Launch:
    """ArduCopter SITL: serial 0 for the companion, 1 (TCP) for an operator, 2 for the truth; free ports."""
    companion, truth, base = _free_port(), _free_port(), _free_tcp_base()
    home = config.home
    heading = math.degrees(config.heading_rad) % 360.0
    where = f"{home.lat_deg:.7f},{home.lon_deg:.7f},{config.home_alt_amsl_m:.3f},{heading:.1f}"
    command = (
        *(str(path), "--model", "quad", "--speedup", "1", "--wipe", "--home", where, "--base-port", str(base)),
        *("--serial0", f"udpclient:{_HOST}:{companion}", "--serial1", "tcp:2"),
        *("--serial2", f"udpclient:{_HOST}:{truth}", "--defaults", "defaults.parm"),
    )
    return Launch("ardupilot", command, {}, f"udpin://{_HOST}:{companion}", f"tcpout://{_HOST}:{base + 2}", truth)


def true_state(message: Any, place: LocalFrame, t_s: float) -> VehicleTruth | None:
    """The true state in a SIM_STATE or HIL_STATE_QUATERNION; None for any other message or numbers out of range."""
    if message.get_type() == "SIM_STATE":
        lat, lon, alt = message.lat_int / 1e7, message.lon_int / 1e7, message.alt
        velocity = (message.ve, message.vn, -message.vd)
        q: Quat = (message.q1, message.q2, message.q3, message.q4)
    elif message.get_type() == "HIL_STATE_QUATERNION":
        lat, lon, alt = message.lat / 1e7, message.lon / 1e7, message.alt / 1e3
        velocity = (message.vy / 100.0, message.vx / 100.0, -message.vz / 100.0)
        w, x, y, z = message.attitude_quaternion
        q = (w, x, y, z)
    else:
        return None
    size = math.sqrt(sum(c * c for c in q))
    if not (0.9 < size < 1.1) or not all(map(math.isfinite, (alt, *velocity))):
        return None
    attitude = multiply(NED_FROM_ENU, q)  # its own inverse up to the sign: ENU from NED from body
    return VehicleTruth(t_s, np.array(place.enu(lat, lon, alt)), np.array(velocity), np.array(attitude) / size)


def _parsed(parser: Any, data: bytes) -> list[Any]:
    try:
        return parser.parse_buffer(data) or []
    except (mavlink.MAVError, ValueError, IndexError, TypeError) as error:
        _log.debug("malformed MAVLink: %s", error)
        return []


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        try:
            s.bind((_HOST, port))
        except OSError:
            return False
    return True


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind((_HOST, 0))
        return int(s.getsockname()[1])


def _free_tcp_base() -> int:
    """A port of which the second next is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as s:
        s.bind((_HOST, 0))
        return int(s.getsockname()[1]) - 2
