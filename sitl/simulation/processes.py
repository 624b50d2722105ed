"""A scenario brought to life: the autopilot's and the camera's processes, and the files that lead a user to them.

The only ties to the program under test are MAVLink, the video stream, and the settings and camera files that any user
would write.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from mission.camera import Camera, Mounting, write_camera
from sitl.aircraft.truth import TruthRing
from sitl.ardrone import ArdroneProcess, ardrone_url, config_of, start_ardrone
from sitl.ardrone.wifi import bad_wifi
from sitl.autopilot import AutopilotConfig, AutopilotProcess, Wind, start_autopilot
from sitl.camera import CameraProcess, start_camera
from sitl.faults.relay import LinkFaults
from sitl.scenario.schema import Scenario
from sitl.scenario.turn import turned
from sitl.simulation.external import ExternalAutopilot, start_external

_USUAL_GIMBAL_AGE_S = 0.05
"""What a user would write who has not measured it."""
TRUTH_SPAN_S = 300.0
TRUTH_RATE_HZ = 250.0
SETTINGS = """\
[link]
url = "{link}"

[video]
url = "{video}"

[camera]
file = "camera.toml"

[answer]
folder = "flights"
"""
ARDRONE_LIMITS = """
[limits]
min_height_m = 0.5
max_speed_m_s = 5.0
"""
"""It flies lower than others, to have a whole person in its flat picture, and the paper's pattern ends fast."""


@dataclass(frozen=True, slots=True)
class Simulation:
    """What runs, and where its files are."""

    scenario: Scenario
    ring: TruthRing
    autopilot: AutopilotProcess | ExternalAutopilot | ArdroneProcess
    camera: CameraProcess | ArdroneProcess
    """An AR.Drone's camera is its own."""
    settings: Path
    """The mission's settings, as `sidestep locate --settings` takes them."""


@contextmanager
def simulation(
    scenario: Scenario, folder: Path, *, extra_settings: str = "", external: str | None = None
) -> Iterator[Simulation]:
    """Start everything that a scenario needs, and stop it at the end.

    Args:
        scenario: what to simulate.
        folder: gets `sidestep.toml` and `camera.toml`; made when it is not there.
        extra_settings: TOML that is appended to the mission's settings.
        external: ``px4:PATH`` or ``ardupilot:PATH``, a user's own autopilot binary instead of the simulated one.

    Raises:
        SidestepError: something did not start.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if scenario.vehicle.kind == "ardrone":
        with _ardrone(scenario, folder, extra_settings) as running:
            yield running
        return
    video = f"udp://127.0.0.1:{_free_udp_port()}"
    if external is not None and external.startswith("px4:"):
        # PX4's SIH starts facing north, and cannot be told otherwise.
        scenario = turned(scenario, -scenario.vehicle.heading_deg)
    if external is not None and external.startswith("ardupilot:"):
        own = scenario.autopilot.model_copy(update={"flavour": "ardupilot"})
        scenario = scenario.model_copy(update={"autopilot": own})
    config = _config(scenario)
    with ExitStack() as stack:
        ring = TruthRing.create(seconds=TRUTH_SPAN_S, rate_hz=TRUTH_RATE_HZ)
        stack.callback(ring.unlink)
        stack.callback(ring.close)
        autopilot = start_external(external, config, ring.name) if external else start_autopilot(config, ring.name)
        stack.callback(autopilot.stop)
        if isinstance(autopilot, ExternalAutopilot):
            autopilot.await_estimator()
        settings = folder / "sidestep.toml"
        settings.write_text(SETTINGS.format(link=autopilot.url, video=video) + extra_settings, encoding="utf-8")
        write_camera(folder / "camera.toml", camera_of(scenario))
        camera = start_camera(scenario, ring.name, video)
        stack.callback(camera.stop)
        yield Simulation(scenario, ring, autopilot, camera, settings)


@contextmanager
def _ardrone(scenario: Scenario, folder: Path, extra_settings: str) -> Iterator[Simulation]:
    """An AR.Drone with its camera, at free ports."""
    with ExitStack() as stack:
        ring = TruthRing.create(seconds=TRUTH_SPAN_S, rate_hz=TRUTH_RATE_HZ)
        stack.callback(ring.unlink)
        stack.callback(ring.close)
        drone = start_ardrone(config_of(scenario), ring.name, scenario)
        stack.callback(drone.stop)
        own, wifi = scenario.ardrone, scenario.ardrone.wifi
        faults = LinkFaults(loss=wifi.loss, duplicate=wifi.duplicate, reorder=wifi.reorder)
        ports = drone.ports
        if faults != LinkFaults():
            ports = stack.enter_context(bad_wifi(ports, faults, scenario.seed))
        width, height = own.scaled_to_px
        url = ardrone_url(drone.config.host, ports)
        url += f"&declination={own.declination_deg:g}&codec={own.video}&size={width}x{height}"
        settings = folder / "sidestep.toml"
        limits = "" if "[limits]" in extra_settings else ARDRONE_LIMITS
        settings.write_text(SETTINGS.format(link=url, video=url) + limits + extra_settings, encoding="utf-8")
        write_camera(folder / "camera.toml", camera_of(scenario))
        yield Simulation(scenario, ring, drone, drone, settings)


def camera_of(scenario: Scenario) -> Camera:
    """The camera as a good calibration would describe it; its latency is left for the flight to find out."""
    settings = scenario.camera
    intrinsics = settings.intrinsics
    if scenario.vehicle.kind == "ardrone":
        width, height = scenario.ardrone.scaled_to_px
        across, down = width / intrinsics.width_px, height / intrinsics.height_px
        intrinsics = replace(
            intrinsics,
            width_px=width,
            height_px=height,
            fx=across * intrinsics.fx,
            cx=across * intrinsics.cx,
            fy=down * intrinsics.fy,
            cy=down * intrinsics.cy,
        )
    carried = scenario.gimbal is not None
    return Camera(
        intrinsics,
        Mounting.tilted(0.0 if carried else math.radians(settings.tilt_down_deg), settings.position_body_m),
        calibrated=True,
        readout_s=settings.readout_ms / 1000.0,
        provenance=f"as the scenario {scenario.name} says",
        gimbal="mavlink" if carried else "none",
        gimbal_age_s=_USUAL_GIMBAL_AGE_S if carried else 0.0,
    )


def _config(scenario: Scenario) -> AutopilotConfig:
    autopilot = scenario.autopilot
    towards = math.radians(autopilot.wind_from_deg + 180.0)
    mean = (autopilot.wind_m_s * math.sin(towards), autopilot.wind_m_s * math.cos(towards), 0.0)
    return AutopilotConfig(
        flavour=autopilot.flavour,
        noise=autopilot.noise,
        seed=scenario.seed,
        home=scenario.home.origin,
        heading_rad=math.radians(scenario.vehicle.heading_deg),
        wind=Wind(mean, autopilot.gust_m_s),
        # As the operator of a real one is asked to: `sidestep locate` does not fly where PX4 would not hold.
        parameters=(("COM_OBL_RC_ACT", 5.0),) if autopilot.flavour == "px4" else (),
        gimbal=scenario.gimbal,
    )


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
