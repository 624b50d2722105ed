"""The MAVProxy module, which `module load gcs_plugin.mavproxy` makes: `locate` and what becomes of it.

It starts `sidestep serve` as a child behind an output of MAVProxy's own, or attaches to one that runs beside the
vehicle, and sends it the operator's orders as the station does. Nothing here flies: `sidestep serve` decides.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from MAVProxy.modules.lib import mp_module, mp_settings, mp_util
from pymavlink import mavutil

from gcs_plugin.exports.targets import Targets
from gcs_plugin.geotags.log import Geotag
from gcs_plugin.mavproxy import arguments
from gcs_plugin.mavproxy.arguments import TypedOrder
from gcs_plugin.mavproxy.help import HELP, WORDS
from gcs_plugin.mavproxy.local_serve import LocalServe
from gcs_plugin.mavproxy.news import News
from gcs_plugin.mavproxy.order_book import OrderBook
from gcs_plugin.mavproxy.output import Message
from gcs_plugin.mavproxy.parameters import ParameterTalk, Peer
from gcs_plugin.mavproxy.serve_process import DEFAULT_PROGRAM
from gcs_plugin.mavproxy.target_map import TargetMap, marker_of, marker_of_fix
from mission.errors import SettingsError, SidestepError
from mission.settings import read_settings

NAME: Final = "gcs_plugin.mavproxy"
"""MAVProxy unloads and reloads a module by this name, which is also where it is imported from."""
TICK_S: Final = 0.1
ASK_S: Final = 3.0
"""Between requests for the size of the picture, until it is known."""


class LocateModule(mp_module.MPModule):  # type: ignore[misc]  # MAVProxy has no types
    """`locate` and what becomes of it.

    Args:
        mpstate: MAVProxy's state.
        values: settings given with `module load gcs_plugin.mavproxy:{"settings":"sidestep.toml"}`.
    """

    def __init__(self, mpstate: Any, values: dict[str, object]) -> None:
        super().__init__(mpstate, NAME, "locate a person by sidestepping", public=True, multi_vehicle=True)
        self.own_settings = mp_settings.MPSettings(
            [
                mp_settings.MPSetting("settings", str, "", label="settings file of sidestep serve"),
                mp_settings.MPSetting("attach", bool, False, label="use a sidestep serve that runs elsewhere"),
                mp_settings.MPSetting("component", int, 100, label="its component id", range=(100, 105)),
                mp_settings.MPSetting("log", str, "", label="GeoPackage of the geotags; empty: as the settings file"),
                mp_settings.MPSetting("targets", int, 20, label="newest targets on the map", range=(0, 1000)),
                mp_settings.MPSetting("program", str, DEFAULT_PROGRAM, label="command of sidestep"),
            ]
        )
        for name, value in values.items():
            if name not in self.own_settings.list() or not self.own_settings.set(name, value):
                raise ImportError(f"no setting {name} = {value}")  # what MAVProxy reports without a traceback
        # windows that MAVProxy forks must not keep the output's port
        forked = mp_util.child_fd_list_add, mp_util.child_fd_list_remove
        self._serve = LocalServe(mpstate.mav_outputs, self._overhear, *forked)
        self._news = News()
        self._present = False
        self._state = ""
        self._drawn: tuple[object, ...] | None = None
        self._orders = OrderBook(self._send_order, self._tell)
        self._parameters = ParameterTalk(self._send, self._tell, self._peer)
        self._targets = Targets(self._log_path)
        self._map = TargetMap()
        self._px4 = False
        self._next_tick_s = 0.0
        self._next_question_s = 0.0
        self.add_command("locate", self._command, "locate a person by sidestepping", [f"<{'|'.join(WORDS)}>"])
        if not self.own_settings.attach:
            self._attempt(self._start)

    def idle_task(self) -> None:
        """MAVProxy calls it some hundred times a second."""
        now = time.monotonic()
        if now < self._next_tick_s:
            return
        self._next_tick_s = now + TICK_S
        self._orders.tick(now)
        self._parameters.tick(now)
        if ended := self._serve.poll():
            self._news = News()
            self._orders.forget()
            self._tell(f"locate: sidestep serve {ended}")
        if self._news.present(now) and self._news.picture is None and now >= self._next_question_s:
            self._next_question_s = now + ASK_S
            self._ask_for_picture()
        self._draw(now)
        self._status_line(now)

    def mavlink_packet(self, message: Message) -> None:
        """A message from the vehicle's system, among them those of `sidestep serve`."""
        sender = message.get_srcSystem(), message.get_srcComponent()
        autopilot = self.target_system, mavutil.mavlink.MAV_COMP_ID_AUTOPILOT1
        if message.get_type() == "HEARTBEAT" and sender == autopilot:
            self._px4 = message.autopilot == mavutil.mavlink.MAV_AUTOPILOT_PX4
        if self._is_ours(message):
            self._take(message)

    def unload(self) -> None:
        """Leave nothing behind: no process, output, map object or command."""
        self._serve.end(self._pump)
        self._map.clear()
        self.remove_command("locate")
        self.console.set_status("Locate", "")

    def _command(self, words: Sequence[str]) -> None:
        self._attempt(lambda: self._run(list(words)))

    def _run(self, words: list[str]) -> None:
        match words:
            case ["help", *_]:
                self._tell(HELP)
            case ["status"]:
                self._tell(self._status(time.monotonic()))
            case ["list"]:
                self._tell(self._targets.table())
            case ["export", name]:
                self._tell(self._targets.export(Path(name)))
            case ["export", *_]:
                raise SettingsError("no file is named", "Type `locate export targets.kml` (or .geojson, .csv).")
            case ["roi", *number]:
                self._point_at(self._targets.find(number[0] if number else None))
            case ["start"]:
                self._start()
            case ["stop"]:
                self._serve.ask_to_end()
            case ["set", *rest]:
                self._set(rest, time.monotonic())
            case _:
                self._order(arguments.order(words, self._news.picture))

    def _attempt(self, do: Callable[[], object]) -> None:
        try:
            do()
        except SidestepError as error:
            self._tell(f"locate: {error}")

    def _order(self, order: TypedOrder) -> None:
        if self.master is None or not self.target_system:
            raise SettingsError("there is no vehicle yet", "Wait for its heartbeat.")
        if not self.own_settings.attach and self._serve.pid is None:
            raise SettingsError("sidestep serve does not run", "Type `locate start`.")
        self._orders.place(order, time.monotonic())

    def _point_at(self, geotag: Geotag) -> None:
        """DO_SET_ROI_LOCATION to the autopilot, from the station: on the operator's request."""
        master, sea_m = self.master, geotag.amsl_m
        if master is None or not self.target_system:
            raise SettingsError("there is no vehicle yet", "Wait for its heartbeat.")
        if sea_m is None:
            raise SettingsError(f"the height of target {geotag.number} above mean sea level is not known")
        lat, lon = round(geotag.place.lat_deg * 1e7), round(geotag.place.lon_deg * 1e7)
        link = mavutil.mavlink
        autopilot = self.target_system, link.MAV_COMP_ID_AUTOPILOT1
        roi = link.MAV_CMD_DO_SET_ROI_LOCATION
        master.mav.command_int_send(*autopilot, link.MAV_FRAME_GLOBAL, roi, 0, 0, 0, 0, 0, 0, lat, lon, sea_m)
        self._tell(f"region of interest: target {geotag.number}")

    # --- sidestep serve ---

    def _start(self) -> None:
        if self.own_settings.attach:
            raise SettingsError("attached to a sidestep serve that runs elsewhere", "`locate set attach 0` ends that.")
        named = self.own_settings.settings
        pid = self._serve.start(self.own_settings.program, Path(named) if named else None)
        self._tell(f"locate: sidestep serve started (process {pid})")

    def _pump(self) -> None:
        """What MAVProxy's main loop does, for the time in which that loop waits for this module to unload."""
        for master in self.mpstate.mav_master:
            if master.fd is not None and select.select([master.fd], [], [], 0.0)[0] and (data := master.recv(16384)):
                master.mav.parse_buffer(data)  # MAVProxy's own callback passes the messages on to the outputs
        output = self._serve.output
        while output is not None and (data := output.recv()):
            for message in output.mav.parse_buffer(data):
                if self.master is not None:
                    self.master.write(message.get_msgbuf())

    def _overhear(self, messages: Sequence[Message]) -> None:
        """What the child sent to the vehicle also goes to MAVProxy's modules and log, and to its other outputs."""
        for message in messages:
            if not self._is_ours(message):
                continue
            if message.get_type() == "HEARTBEAT":
                # MAVProxy would take it as a sign of life of the vehicle's link
                self._take(message)
                for output in self.mpstate.mav_outputs:
                    if output is not self._serve.output:
                        output.write(message.get_msgbuf())
                continue
            self._pass_on(message)

    def _pass_on(self, message: Message) -> None:
        link, master, output = self.module("link"), self.master, self._serve.output
        if link is None or master is None or output is None:
            return
        output.muted = True
        try:
            link.master_callback(message, master)
        finally:
            output.muted = False

    def _is_ours(self, message: Message) -> bool:
        return bool(
            message.get_srcSystem() == self.target_system and message.get_srcComponent() == self.own_settings.component
        )

    def _take(self, message: Message) -> None:
        now = time.monotonic()
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            us = self.settings.source_system, self.settings.source_component
            if (message.target_system, message.target_component) in (us, (us[0], 0), (0, 0)):
                self._orders.ack(message, now)
        elif kind == "PARAM_VALUE":
            self._parameters.value(message, now)
        elif (text := self._news.take(message, now)) and not self.message_is_from_primary_vehicle(message):
            self._tell(text)  # those of the component that is selected are shown by MAVProxy itself

    # --- talking ---

    def _send(self, message: Message) -> None:
        master = self.master
        if master is None:
            return
        if self._serve.output is None:
            master.mav.send(message)
        else:
            self._serve.output.write(message.pack(master.mav))  # signed, where the station signs

    def _send_order(self, order: TypedOrder, sendings: int) -> None:
        seven = [*order.params, *([0.0] * 7)][:7]
        system, component = self.target_system, self.own_settings.component
        self._send(mavutil.mavlink.MAVLink_command_long_message(system, component, order.command, sendings, *seven))

    def _ask_for_picture(self) -> None:
        for wanted in ("VIDEO_STREAM_INFORMATION", "CAMERA_INFORMATION"):
            number = getattr(mavutil.mavlink, f"MAVLINK_MSG_ID_{wanted}")
            self._send_order(TypedOrder(mavutil.mavlink.MAV_CMD_REQUEST_MESSAGE, (float(number),)), 0)

    # --- what the operator sees ---

    def _set(self, words: Sequence[str], now_s: float) -> None:
        if not words or words[0] in self.own_settings.list() or "*" in words[0]:
            self.own_settings.command(list(words))
        else:
            self._parameters.begin(words[0], words[1] if len(words) > 1 else None, now_s)

    def _status(self, now_s: float) -> str:
        news = self._news
        serve = "attached" if self.own_settings.attach else "not running"
        if self._serve.pid is not None:
            serve = f"{'ending' if self._serve.ending else 'running'} (process {self._serve.pid})"
        component = f"component {self.target_system}:{self.own_settings.component}"
        heard = "heard" if news.present(now_s) else "not heard"
        lines = [
            f"sidestep serve: {serve}, {component} {heard}",
            f"order: {self._orders.summary() or 'none'}; target {'tracked' if news.tracking else 'not tracked'}",
        ]
        if news.fix is not None:
            name = "last target" if news.number is None else f"target {news.number}"
            lines.append(f"{name}: {news.fix.lat_deg:.7f} {news.fix.lon_deg:.7f}")
        if news.text:
            lines.append(f"last text: {news.text}")
        return "\n".join(lines)

    def _status_line(self, now_s: float) -> None:
        present = self._news.present(now_s)
        if present != self._present:
            self._present = present
            self._tell(f"locate: sidestep serve is {'ready' if present else 'not heard any more'}")
        state = (self._orders.summary() or ("tracking" if self._news.tracking else "ready")) if present else "not heard"
        if state != self._state:
            self._state = state
            self.console.set_status("Locate", f"Locate: {state}", row=6, fg="green" if present else "red")

    def _draw(self, now_s: float) -> None:
        module, count = self.module("map"), self.own_settings.targets
        if module is None:
            self._map.show(None, ())
            self._drawn = None
            return
        geotags = self._targets.newest(count, now_s)
        wanted = (id(module.map), self._targets.version, count, self._news.fix, self._news.number)
        if wanted == self._drawn:
            return
        markers = [marker_of(geotag) for geotag in geotags]
        if not markers and self._news.fix is not None and count:
            markers = [marker_of_fix(self._news.fix, self._news.number or 0)]
        self._map.show(module.map, markers)
        self._drawn = wanted

    def _log_path(self) -> Path:
        if self.own_settings.log:
            return Path(self.own_settings.log)
        if self.own_settings.attach:
            raise SettingsError("the log of a sidestep serve elsewhere is not known", "`locate set log FILE` names it.")
        named = self.own_settings.settings
        return read_settings(Path(named) if named else None).answer.folder / "geotags.gpkg"

    def _peer(self) -> Peer:
        return Peer(self.target_system, self.own_settings.component, "bytewise" if self._px4 else "c-cast")

    def _tell(self, text: str) -> None:
        self.console.writeln(text)
