"""`python -m sitl.ardrone`: a simulated AR.Drone 2.0 at its own UDP and TCP ports."""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from mission.errors import SidestepError
from sitl.aircraft.server import run_program
from sitl.aircraft.truth import TruthRing
from sitl.ardrone.camera import VideoPort, start_camera
from sitl.ardrone.config import HEADER_SIZES, ArdroneConfig, config_of
from sitl.ardrone.server import ArdroneServer
from sitl.scenario.schema import Scenario, read_scenario

_TRUTH_SPAN_S = 60.0
_TRUTH_RATE_HZ = 250.0
_SWITCHED_ON_S = (20.0, 200.0)
"""The aircraft was switched on this long ago: its clock starts at no round number."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly until interrupted (or until standard input ends, with --control)."""
    chosen = _parser().parse_args(arguments)
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr)
    with ExitStack() as stack:
        try:
            scenario = _scenario(chosen.scenario, chosen.scenario_json)
            server = _server(stack, _config(chosen, scenario), chosen.truth, scenario)
        except (SidestepError, OSError) as error:
            sys.stderr.write(f"{error}\n")
            return 1
        run_program(server, asdict(server.ports), orders=chosen.control)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m sitl.ardrone", description=__doc__)
    parser.add_argument("--scenario", type=Path, help="what its camera sees (TOML); without one there is no video")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    parser.add_argument("--at-port", type=int, default=5556)
    parser.add_argument("--navdata-port", type=int, default=5554)
    parser.add_argument("--video-port", type=int, default=5555)
    parser.add_argument("--control-port", type=int, default=5559)
    parser.add_argument("--pave-header", type=int, choices=HEADER_SIZES, default=64, help="bytes before each picture")
    parser.add_argument("--noise", choices=["good", "rough", "none"], help="of the sensors; the scenario's by default")
    parser.add_argument("--seed", type=int, help="the scenario's by default")
    parser.add_argument("--gps", action="store_true", help="the GPS edition")
    parser.add_argument("--config", help="everything, as ArdroneConfig.to_json writes it")
    parser.add_argument("--scenario-json", help="the scenario in its JSON form")
    parser.add_argument("--truth", help="name of the truth ring to write to")
    parser.add_argument("--control", action="store_true", help="take orders from standard input, stop at its end")
    return parser


def _scenario(path: Path | None, text: str | None) -> Scenario | None:
    if text is not None:
        return Scenario.model_validate_json(text)
    return None if path is None else read_scenario(path)


def _config(chosen: argparse.Namespace, scenario: Scenario | None) -> ArdroneConfig:
    if chosen.config:
        return ArdroneConfig.from_json(chosen.config)
    config = replace(
        ArdroneConfig() if scenario is None else config_of(scenario),
        host=chosen.host,
        at_port=chosen.at_port,
        navdata_port=chosen.navdata_port,
        video_port=chosen.video_port,
        control_port=chosen.control_port,
        pave_header_bytes=chosen.pave_header,
    )
    if chosen.noise is not None:
        config = replace(config, noise=chosen.noise)
    if chosen.seed is not None:
        config = replace(config, seed=chosen.seed)
    return replace(config, gps=True) if chosen.gps else config


def _server(
    stack: ExitStack, config: ArdroneConfig, truth_name: str | None, scenario: Scenario | None
) -> ArdroneServer:
    truth = _truth(stack, truth_name) if truth_name is not None or scenario is not None else None
    booted_s = time.monotonic() - float(np.random.default_rng(config.seed).uniform(*_SWITCHED_ON_S))
    camera = None
    if scenario is not None and truth is not None:
        where = VideoPort(config.host, config.video_port, booted_s, config.pave_header_bytes)
        camera = start_camera(scenario, truth.name, where)
        stack.callback(camera.stop)
    return ArdroneServer(config, truth, booted_s=booted_s, camera=camera)


def _truth(stack: ExitStack, name: str | None) -> TruthRing:
    if name is not None:
        ring = TruthRing.attach(name)
    else:
        ring = TruthRing.create(seconds=_TRUTH_SPAN_S, rate_hz=_TRUTH_RATE_HZ)
        stack.callback(ring.unlink)
    stack.callback(ring.close)
    return ring


if __name__ == "__main__":
    sys.exit(main())
