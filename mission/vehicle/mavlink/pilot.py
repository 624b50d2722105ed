"""The pilot process of a MAVLink vehicle, the only thing that flies it.

`PilotProcess` starts it as ``python -m mission.vehicle.mavlink.pilot CONFIG``. It owns the vehicle's connection
(MAVSDK, forwarding to the program's pymavlink over loopback UDP), and reads orders from its standard input. Its loop,
and what stops the vehicle, is in `mission.vehicle.pilot.loop`.
"""

from __future__ import annotations

import contextlib
import logging
import math
import queue
import sys
import time
from typing import Any

from mavsdk.enums import ForwardingOption
from mavsdk.exceptions import ConnectionError as MavsdkConnectionError
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.system import System
from pymavlink.dialects.v20 import all as mavlink

from mission.errors import LinkError
from mission.vehicle.fence import Fence
from mission.vehicle.limits import FlightSettings
from mission.vehicle.mavlink.controls import MavsdkControls
from mission.vehicle.mavlink.decode_throttle import DecodeThrottle
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.mavlink.pilot_config import MAVSDK_COMPONENT, PILOT_COMPONENT, PROGRAM_COMPONENT, PilotConfig
from mission.vehicle.mavlink.rates import MessageRates, ask_rate
from mission.vehicle.mavlink.safeguards import SAFEGUARD_MESSAGES, Safeguards
from mission.vehicle.pilot.loop import run
from mission.vehicle.pilot.loopback import loopback_socket
from mission.vehicle.pilot.preconditions import Guards
from mission.vehicle.pilot.protocol import EventReport
from mission.vehicle.pilot.rules import FlightRules
from mission.vehicle.state.packet_loss import PacketLoss
from mission.vehicle.state.vehicle_state import VEHICLE_MESSAGES, VehicleState

_LOG = logging.getLogger(__name__)

_FOREIGN = ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET", "COMMAND_INT")
_DO_REPOSITION = 192
_GET_TO_KNOW_S = 6.0
_ASK_TARGET_S = 2.0
_ASK_TARGET_TIMES = 3
_TARGET_HZ = 200.0
_IDLE_TARGET_HZ = 2.0
_ANSWERED_S = 1.0
_RECEIVER_HZ = 2.0
_RECEIVER_ASKS = 5


class _Vehicle:
    """The connections: MAVSDK on its own, and two loopback links behind it; `pilot_loop.Aircraft` and `Guards`."""

    farewell_s = 6.0
    idle_tick_s = 0.05
    sign_of_life = "the autopilot's heartbeat"

    def __init__(self, config: PilotConfig) -> None:
        self.settings: FlightSettings = config.flight
        self.mavsdk, self.system = _connect(config)
        self.state = VehicleState(self.system.get_system_id())
        self.safeguards = Safeguards(self.state)
        self.loss = PacketLoss()
        self.rivals: queue.SimpleQueue[tuple[str, bool]] = queue.SimpleQueue()
        self._own = {MAVSDK_COMPONENT, PILOT_COMPONENT, PROGRAM_COMPONENT}
        handled = (*VEHICLE_MESSAGES, *_FOREIGN, *SAFEGUARD_MESSAGES, "COMMAND_ACK")
        self._thinning = DecodeThrottle(self.state.system, time.monotonic(), sparing=config.sparing, bounded=handled)
        self._cautioned = False
        self._reposition_s = -math.inf
        sock = loopback_socket()
        port = sock.getsockname()[1]
        self.link = MavlinkLink(
            sock,
            source_system=self.state.system,
            source_component=PILOT_COMPONENT,
            target_system=self.state.system,
            handler=self._take,
            handled=handled,
            wants=self._look_at,
            at_leisure=self._thinning.at_leisure,
        )
        self.controls = MavsdkControls(self.system, self.link, self.state, self.loss, release=config.flight.release)
        for loopback in (port, config.program_port):
            self.mavsdk.add_any_connection_with_handle_and_forwarding(
                f"udpout://127.0.0.1:{loopback}", ForwardingOption.ON
            )
        self.rates: MessageRates | None = None
        self._target_asked_s = -_ASK_TARGET_S
        self._target_watched = False
        self._receiver_asked_s, self._receiver_asks = -_ASK_TARGET_S, _RECEIVER_ASKS
        self._target_asks = _ASK_TARGET_TIMES

    def get_to_know(self) -> None:
        """Hear what must be known of it before it may be flown, or as much as comes: an order may follow at once."""
        until_s = time.monotonic() + _GET_TO_KNOW_S
        while not (self.safeguards.known and self.state.told) and (now := time.monotonic()) < until_s:
            self.keep_rates(now)
            self.safeguards.ask(self.link, now)
            time.sleep(0.02)  # paces the asking; the answers come in the link's thread

    @property
    def guards(self) -> Guards:
        """Its safeguards, and its link."""
        return self

    def look(self, flight: FlightRules, now_s: float) -> list[EventReport]:
        """Hand over what others on the link order, and ask the autopilot for what is to be known."""
        with contextlib.suppress(queue.Empty):
            while True:
                text, obeyed = self.rivals.get_nowait()
                flight.rival(text, now_s, obeyed=obeyed)
        if flight.phase != "idle":
            self._thinning.need(now_s)
        self.keep_rates(now_s)
        self.safeguards.ask(self.link, now_s)
        self.watch_target(flight.phase in ("entering", "flying"), now_s)
        if self._cautioned or not self.safeguards.known:
            return []
        self._cautioned = True
        return [EventReport(t_s=now_s, kind="caution", text=text) for text in self.safeguards.cautions()]

    def order_begins(self) -> None:
        """Look again at the fence plan."""
        self.safeguards.order_begins()

    def send(self, now_s: float) -> None:
        """Nothing: the controls have sent it."""

    def keep_rates(self, now_s: float) -> None:
        """Ask for what the flight watches, in the autopilot's own terms."""
        if self.rates is None and self.state.heartbeat_s is not None:
            wanted = {"LOCAL_POSITION_NED": 50.0, "GLOBAL_POSITION_INT": 50.0, "ATTITUDE": 50.0}
            wanted |= {"EXTENDED_SYS_STATE": 5.0, "SYS_STATUS": 2.0, "GPS_RAW_INT": 5.0, "HOME_POSITION": 1.0}
            if self.state.autopilot == "px4":
                wanted |= {"CURRENT_MODE": 20.0, "ESTIMATOR_STATUS": 1.0}
            else:
                wanted |= {"EKF_STATUS_REPORT": 2.0, "RC_CHANNELS": 2.0}
            self.rates = MessageRates(self.link, wanted, now_s, self._thinning.passed_over)
        if self.rates is not None:
            self.rates.keep(now_s)
        self.ask_other_receiver(now_s)

    def ask_other_receiver(self, now_s: float) -> None:
        """Ask for the second GPS receiver: once, and a few times where the first has no fix. There may be none."""
        if self.state.gps_fix >= mavlink.GPS_FIX_TYPE_3D_FIX and self._receiver_asks < _RECEIVER_ASKS:
            self._receiver_asks = _RECEIVER_ASKS - 1
        elif (
            self.state.heartbeat_s is not None
            and self._receiver_asks
            and now_s - self._receiver_asked_s > _ASK_TARGET_S
        ):
            self._receiver_asked_s, self._receiver_asks = now_s, self._receiver_asks - 1
            ask_rate(self.link, "GPS2_RAW", _RECEIVER_HZ)

    def fence(self) -> Fence | None:
        """The autopilot's geofence."""
        return self.safeguards.fence()

    def refusal(self, must_hold: bool) -> str | None:
        """Why the autopilot's own reactions forbid a flight."""
        return self.safeguards.refusal(must_hold)

    def packet_loss(self, now_s: float) -> float | None:
        """Fraction of the autopilot's packets that do not arrive."""
        return self.loss.fraction(now_s)

    def watch_target(self, flying: bool, now_s: float) -> None:
        """Ask ArduPilot for its own target, which is all that shows an operator's "fly here" in GUIDED.

        It is there only until our next setpoint, so it is asked for at the highest rate while we fly. That costs
        nothing: following our setpoints it has no target to report (ModeGuided::get_wp).
        """
        changed, self._target_watched = flying != self._target_watched, flying
        self._target_asks = 0 if changed else self._target_asks
        due = changed or now_s - self._target_asked_s > _ASK_TARGET_S
        # Without an end while we fly, since the autopilot may have forgotten; afterwards a few times, for lossy links.
        if self.state.autopilot == "ardupilot" and due and (flying or self._target_asks < _ASK_TARGET_TIMES):
            self._target_asked_s, self._target_asks = now_s, self._target_asks + 1
            ask_rate(self.link, "POSITION_TARGET_GLOBAL_INT", _TARGET_HZ if flying else _IDLE_TARGET_HZ)

    def close(self) -> None:
        """Silence everything."""
        self.controls.release()
        self.link.close()
        self.mavsdk.destroy()

    def _look_at(self, message_id: int, frame: bytes, arrived_s: float) -> bool:
        self.loss.observe(frame, self.state.system, arrived_s)
        return self._thinning.wants(message_id, frame, arrived_s)

    def _take(self, message: Any, arrived_s: float) -> None:
        name = message.get_type()
        if name in SAFEGUARD_MESSAGES:
            self.safeguards.take(message)
            return
        if name == "COMMAND_ACK":
            self.controls.take_answer(message, arrived_s)
            self._take_others_answer(message, arrived_s)
            return
        if name not in _FOREIGN:
            self.state.update(message, arrived_s)
            return
        ours = message.get_srcSystem() == self.state.system and message.get_srcComponent() in self._own
        if ours or message.target_system not in (0, self.state.system):
            return
        if name != "COMMAND_INT" or message.command == _DO_REPOSITION:
            who = f"{message.get_srcSystem()}/{message.get_srcComponent()}"
            self._reposition_s = arrived_s if name == "COMMAND_INT" else self._reposition_s
            self.rivals.put((f"another controller ({who}) sent {name}", False))

    def _take_others_answer(self, ack: Any, arrived_s: float) -> None:
        """The autopilot goes where somebody else, seen just before, has sent it."""
        sender = ack.get_srcSystem(), ack.get_srcComponent()
        taken = ack.command == _DO_REPOSITION and ack.result == mavlink.MAV_RESULT_ACCEPTED
        if taken and sender == (self.state.system, 1) and arrived_s - self._reposition_s < _ANSWERED_S:
            self._reposition_s = -math.inf
            self.rivals.put(("another controller sent it to another place", True))


def _connect(config: PilotConfig) -> tuple[Mavsdk, System]:
    """Opens the vehicle's connection as a companion with the vehicle's own system id.

    Raises:
        LinkError: the address cannot be opened, or no autopilot is heard.
    """
    own = config.target_system or 1
    deadline = time.monotonic() + config.connect_timeout_s
    for _ in range(3):
        mavsdk = Mavsdk(Configuration.create_manual(own, MAVSDK_COMPONENT, True))
        try:
            mavsdk.add_any_connection_with_handle_and_forwarding(config.url, ForwardingOption.ON)
        except MavsdkConnectionError as refused:
            mavsdk.destroy()
            raise LinkError(
                f"cannot open {config.url} ({refused})", "Check the address and who else uses it"
            ) from refused
        system = _wait_for_system(mavsdk, config.target_system, deadline)
        if system is None:
            error = _not_heard(config, [s.get_system_id() for s in mavsdk.get_systems() if s.has_autopilot()])
            mavsdk.destroy()
            raise error
        if system.get_system_id() == own:
            return mavsdk, system
        own = system.get_system_id()
        mavsdk.destroy()
    raise LinkError(f"the system id on {config.url} keeps changing", "Set target_system")


def _not_heard(config: PilotConfig, heard: list[int]) -> LinkError:
    if heard:
        others = ", ".join(map(str, sorted(heard)))
        return LinkError(
            f"no autopilot with system id {config.target_system} is heard on {config.url}, only {others}",
            "Set link.system to the vehicle's system id, or to 0 for the first that is heard",
        )
    return LinkError(f"no autopilot is heard on {config.url}", "Check that the vehicle is on and sends to this address")


def _wait_for_system(mavsdk: Mavsdk, wanted: int, deadline_s: float) -> System | None:
    while time.monotonic() < deadline_s:
        for system in mavsdk.get_systems():
            if system.has_autopilot() and wanted in (0, system.get_system_id()):
                return system
        time.sleep(0.02)  # looks again until the deadline
    return None


def main(arguments: list[str]) -> int:
    """Run until the program goes; exit status 0 after an orderly end."""
    return run(lambda _: _known_vehicle(PilotConfig.model_validate_json(arguments[0] if arguments else "")))


def _known_vehicle(config: PilotConfig) -> _Vehicle:
    vehicle = _Vehicle(config)
    vehicle.get_to_know()
    return vehicle


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
