"""A scenario brought to life: the autopilot's and the camera's processes, and the files that lead a user to them.

The only ties to the program under test are MAVLink, the video stream, and the settings and camera files that any user
would write.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from mission.camera import Camera, Mounting, write_camera
from sitl.autopilot import AutopilotConfig, AutopilotProcess, Wind, start_autopilot
from sitl.camera import CameraProcess, start_camera
from sitl.external import ExternalAutopilot, start_external
from sitl.scenario import Scenario
from sitl.truth import TruthRing

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


@dataclass(frozen=True, slots=True)
class Simulation:
    """What runs, and where its files are."""

    scenario: Scenario
    ring: TruthRing
    autopilot: AutopilotProcess | ExternalAutopilot
    camera: CameraProcess
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
    video = f"udp://127.0.0.1:{_free_udp_port()}"
    config = _config(scenario)
    with ExitStack() as stack:
        ring = TruthRing.create(seconds=TRUTH_SPAN_S, rate_hz=TRUTH_RATE_HZ)
        stack.callback(ring.unlink)
        stack.callback(ring.close)
        autopilot = start_external(external, config, ring.name) if external else start_autopilot(config, ring.name)
        stack.callback(autopilot.stop)
        settings = folder / "sidestep.toml"
        settings.write_text(SETTINGS.format(link=autopilot.url, video=video) + extra_settings, encoding="utf-8")
        write_camera(folder / "camera.toml", camera_of(scenario))
        camera = start_camera(scenario, ring.name, video)
        stack.callback(camera.stop)
        yield Simulation(scenario, ring, autopilot, camera, settings)


def camera_of(scenario: Scenario) -> Camera:
    """The camera as a good calibration would describe it; its latency is left for the flight to find out."""
    settings = scenario.camera
    return Camera(
        settings.intrinsics,
        Mounting.tilted(math.radians(settings.tilt_down_deg), settings.position_body_m),
        calibrated=True,
        readout_s=settings.readout_ms / 1000.0,
        provenance=f"as the scenario {scenario.name} says",
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
    )


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
