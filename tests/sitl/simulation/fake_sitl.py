"""Stands in for a PX4 or ArduPilot SITL binary: understands the arguments and tells a true pose when it is asked."""

from __future__ import annotations

import os
import socket
import sys
import time

from pymavlink.dialects.v20 import all as mavlink


def main() -> None:
    px4 = "-i" in sys.argv
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    if px4:
        instance = int(sys.argv[sys.argv.index("-i") + 1])
        link.bind(("127.0.0.1", 19450 + instance))
        peer = ("127.0.0.1", 19410 + instance)
        lat, lon, alt = (float(os.environ[f"PX4_HOME_{name}"]) for name in ("LAT", "LON", "ALT"))
        assert os.environ["PX4_SIM_MODEL"] == "sihsim_quadx"
        if os.environ.get("PX4_PARAM_COM_OBL_RC_ACT") == "7":
            lat += 5.0  # as when the home is misunderstood
    else:
        peer = ("127.0.0.1", int(sys.argv[sys.argv.index("--serial2") + 1].split(":")[2]))
        lat, lon, alt = (float(x) for x in sys.argv[sys.argv.index("--home") + 1].split(",")[:3])
        assert "FRAME_CLASS 1" in open(sys.argv[sys.argv.index("--defaults") + 1]).read()  # noqa: SIM115
    link.setblocking(False)
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    asked, start = False, time.monotonic()
    while time.monotonic() - start < 20.0:
        try:
            messages = mav.parse_buffer(link.recv(4096)) or []
        except BlockingIOError:
            messages = []
        for m in messages:
            if m.get_type() == "HEARTBEAT" and m.type == mavlink.MAV_TYPE_GCS:
                sys.exit("a ground station")
            if m.get_type() == "COMMAND_LONG" and m.command == 511 and m.param2 == 20000.0:
                asked = m.param1 == (115 if px4 else 108)
        t = time.monotonic() - start
        east = 2.0 * t / 111320.0  # about, degrees
        q = [0.7071068, 0.0, 0.0, 0.7071068]  # heading east
        where = (round(lat * 1e7), round((lon + east) * 1e7))
        if not asked:
            m = mavlink.MAVLink_heartbeat_message(2, 12 if px4 else 3, 0, 0, 3, 3)
        elif px4:
            m = mavlink.MAVLink_hil_state_quaternion_message(
                *(0, q, 0, 0, 0, *where, round((alt + 3.0) * 1e3), 0, 200, 0, 0, 0, 0, 0, 0)
            )
        else:
            m = mavlink.MAVLink_sim_state_message(
                *(*q, 0, 0, 1.5707963, 0, 0, -9.8, 0, 0, 0, 0, 0, alt + 3.0, 0, 0, 0, 2.0, 0, *where)
            )
        link.sendto(bytes(m.pack(mav)), peer)
        if not px4:
            ready = t > 1.0
            health = mavlink.MAV_SYS_STATUS_PREARM_CHECK if ready else 0
            for m in (
                mavlink.MAVLink_ekf_status_report_message(831 if ready else 0x127, 0.0, 0.0, 0.0, 0.0, 0.0),
                mavlink.MAVLink_sys_status_message(health, health, health, 0, 12000, 0, 90, 0, 0, 0, 0, 0, 0),
            ):
                link.sendto(bytes(m.pack(mav)), peer)
        time.sleep(0.02)


if __name__ == "__main__":
    main()
