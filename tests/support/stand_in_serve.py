"""Stands in for `sidestep serve`: a camera component that answers orders and flies nothing.

Run as ``python -m tests.support.stand_in_serve serve --link udpout://HOST:PORT [--settings FILE]``. Locates only
while the vehicle is armed: a few reports of progress, then a geotag in the log, 276, a text and the final answer.
Asked to end (SIGTERM) in the middle of that, it ends when the autopilot has acknowledged a last command of its.
"""

from __future__ import annotations

import argparse
import signal
import socket
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.geotags.log import GeotagLog
from gcs_plugin.mavproxy.child import end_with_parent
from gcs_plugin.mavproxy.order_book import CANCELLED
from gcs_plugin.publish.messages import statustexts
from mission.settings import read_settings
from mission.vehicle.mavlink.framing import decode, frames
from tests.support.sample import geotag

COMPONENT = 100
NEWS_S = 0.2


@dataclass
class StandIn:
    link: socket.socket
    log: GeotagLog
    system: int = 0
    armed: bool = False
    began_s: float | None = None
    beat_s: float = 0.0
    ending: bool = False
    asked_by: tuple[int, int] = (0, 0)
    speed: float = 3.0
    sent: mavlink.MAVLink = field(default_factory=lambda: mavlink.MAVLink(None, 1, COMPONENT))

    def send(self, message: Any) -> None:
        self.sent.srcSystem = self.system or 1
        self.link.send(message.pack(self.sent))
        self.sent.seq = (self.sent.seq + 1) % 256

    def say(self, text: str) -> None:
        for message in statustexts(text, mavlink.MAV_SEVERITY_INFO, 7):
            self.send(message)

    def ack(self, command: int, result: int, progress: int = 0) -> None:
        self.send(mavlink.MAVLink_command_ack_message(command, result, progress, 0, *self.asked_by))

    def take(self, message: Any) -> None:
        match message.get_type():
            case "HEARTBEAT" if message.get_srcComponent() == 1:
                self.system = message.get_srcSystem()
                self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            case "COMMAND_LONG" if message.target_component == COMPONENT:
                self.asked_by = (message.get_srcSystem(), message.get_srcComponent())
                self.order(message)
            case "COMMAND_ACK" if message.target_component == COMPONENT and self.ending:
                sys.exit(0)
            case "PARAM_REQUEST_READ" if message.target_component == COMPONENT:
                self.parameter(message.param_id)
            case "PARAM_SET" if message.target_component == COMPONENT:
                self.speed = min(message.param_value, 5.0)
                self.parameter(message.param_id)

    def order(self, message: Any) -> None:
        match message.command:
            case mavlink.MAV_CMD_USER_1 if not self.armed:
                self.ack(message.command, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
                self.say("sidestep: refused: the aircraft is not armed and airborne, so there is nothing to fly")
            case mavlink.MAV_CMD_USER_1:
                self.began_s = time.monotonic()
                box = " ".join(f"{value:.3f}" for value in (message.param1, message.param2, message.param3))
                self.say(f"sidestep: asked for {box} {message.param4:.3f}")
                self.ack(message.command, mavlink.MAV_RESULT_IN_PROGRESS, 0)
            case mavlink.MAV_CMD_USER_3:
                signed = message.get_header().incompat_flags & mavlink.MAVLINK_IFLAG_SIGNED
                self.say(f"sidestep: next, {'signed' if signed else 'unsigned'}")
                self.ack(message.command, mavlink.MAV_RESULT_ACCEPTED)
            case mavlink.MAV_CMD_USER_2:
                if self.began_s is not None:
                    self.began_s = None
                    self.ack(mavlink.MAV_CMD_USER_1, CANCELLED)
                self.ack(message.command, mavlink.MAV_RESULT_ACCEPTED)
            case mavlink.MAV_CMD_REQUEST_MESSAGE if message.param1 == mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION:
                self.send(
                    mavlink.MAVLink_camera_information_message(
                        0, [0] * 32, [0] * 32, 0, 0.0, 0.0, 0.0, 640, 480, 0, 0, 0, b""
                    )
                )
            case _:
                self.ack(message.command, mavlink.MAV_RESULT_UNSUPPORTED)

    def parameter(self, name: str) -> None:
        if name == "LIMITS_SPEED":
            kind = mavlink.MAV_PARAM_TYPE_REAL32
            self.send(mavlink.MAVLink_param_value_message(name.encode(), self.speed, kind, 1, 0))

    def last_command(self) -> None:
        place = 372276900, 1268405000, 0.0
        roi = mavlink.MAV_CMD_DO_SET_ROI_LOCATION
        self.send(mavlink.MAVLink_command_int_message(self.system, 1, 0, roi, 0, 0, 0, 0, 0, 0, *place))

    def tick(self, now_s: float) -> None:
        if self.ending and self.began_s is None:
            sys.exit(0)
        if self.ending:
            self.last_command()
            return
        if now_s >= self.beat_s:
            self.beat_s = now_s + NEWS_S
            self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_CAMERA, 8, 0, 0, 4, 3))
            if self.began_s is not None:
                self.ack(mavlink.MAV_CMD_USER_1, mavlink.MAV_RESULT_IN_PROGRESS, 50)
        if self.began_s is not None and now_s - self.began_s > 5 * NEWS_S:
            self.began_s = None
            tag = self.log.append(geotag(f"tag-{time.time_ns()}")).geotag
            lat, lon = round(tag.place.lat_deg * 1e7), round(tag.place.lon_deg * 1e7)
            unknown = [float("nan")] * 8
            self.send(mavlink.MAVLink_camera_tracking_geo_status_message(1, lat, lon, 30.0, 0.4, 0.1, *unknown[:7]))
            self.say(f"target {tag.number}: {tag.place.lat_deg:.6f} {tag.place.lon_deg:.6f} CE90 {tag.ce90_m:.1f} m")
            self.ack(mavlink.MAV_CMD_USER_1, mavlink.MAV_RESULT_ACCEPTED)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("serve")
    parser.add_argument("--link", required=True)
    parser.add_argument("--settings", type=Path)
    arguments = parser.parse_args()
    scheme, _, address = arguments.link.partition("://")
    host, port = address.split(":")
    end_with_parent(0)
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    if scheme == "udpin":
        link.bind((host, int(port)))
        link.connect(link.recvfrom(65535)[1])
    else:
        link.connect((host, int(port)))
    link.settimeout(0.05)
    folder = read_settings(arguments.settings).answer.folder
    stand_in, packets = StandIn(link, GeotagLog(folder / "geotags.gpkg")), mavlink.MAVLink(None)
    signal.signal(signal.SIGTERM, lambda *_: setattr(stand_in, "ending", True))
    while True:
        stand_in.tick(time.monotonic())
        try:
            data = link.recv(65535)
        except OSError:
            continue
        for _, frame in frames(data):
            if (message := decode(packets, frame)) is not None:
                stand_in.take(message)


if __name__ == "__main__":
    main()
