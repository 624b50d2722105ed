"""Sends MAVLink frames as fast as told, from a socket that was opened by another process.

``python -m tests.support.flooder FD PORT RATE SECONDS`` floods the loopback port with unsigned commands, parameters,
setpoints and heartbeats under the operator's id, a datagram each, and writes each second how many it has sent a second.
"""

from __future__ import annotations

import socket
import sys
import time

from pymavlink.dialects.v20 import all as mavlink

STEP_S = 0.001


def main(fd: int, port: int, rate_hz: float, seconds: float) -> None:
    """Send."""
    sock = socket.socket(fileno=fd)
    sender = mavlink.MAVLink(None, 255, 190)
    frames = [
        mavlink.MAVLink_command_long_message(1, 100, mavlink.MAV_CMD_USER_1, 0, *([0.0] * 7)).pack(sender),
        mavlink.MAVLink_command_long_message(1, 100, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 259.0, *([0.0] * 6)).pack(
            sender
        ),
        mavlink.MAVLink_param_set_message(1, 100, b"REPEAT", 4.0, 9).pack(sender),
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(sender),
        mavlink.MAVLink_command_int_message(1, 1, 0, 192, 0, 0, *([0.0] * 4), 0, 0, 0.0).pack(sender),
        mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 0.5).pack(sender),
        mavlink.MAVLink_statustext_message(6, b"flood").pack(sender),
    ]
    began_s = time.monotonic()
    sent, told_s = 0, 0.0
    while (past_s := time.monotonic() - began_s) < seconds:
        while sent < past_s * rate_hz:
            sock.sendto(frames[sent % len(frames)], ("127.0.0.1", port))
            sent += 1
        if past_s - told_s > 1.0:
            told_s = past_s
            sys.stdout.write(f"{sent / past_s}\n")
            sys.stdout.flush()
        time.sleep(STEP_S)  # paces the flood


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4]))
