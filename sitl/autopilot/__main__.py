"""`python -m sitl.autopilot`: a simulated PX4 or ArduPilot on the loopback interface."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace

from sitl.aircraft.server import run_program
from sitl.aircraft.truth import TruthRing
from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.estimate_errors import NOISE_NAMES
from sitl.autopilot.server import AutopilotServer


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly until interrupted (or until standard input ends, with --control)."""
    parser = argparse.ArgumentParser(prog="python -m sitl.autopilot", description=__doc__)
    parser.add_argument("--flavour", choices=["px4", "ardupilot"], default="px4")
    parser.add_argument("--noise", choices=NOISE_NAMES, default="good")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--remote-port", type=int, default=14540, help="UDP port that it sends to (udpin there)")
    parser.add_argument("--operator-port", type=int, default=14550, help="UDP port that it listens on (udpout there)")
    parser.add_argument("--tcp-port", type=int, default=None, help="TCP port that it serves (tcpout there)")
    parser.add_argument("--config", help="everything, as AutopilotConfig.to_json writes it")
    parser.add_argument("--truth", help="name of the truth ring to write to")
    parser.add_argument("--control", action="store_true", help="take orders from standard input, stop at its end")
    chosen = parser.parse_args(arguments)
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr)
    if chosen.config:
        config = AutopilotConfig.from_json(chosen.config)
    else:
        config = replace(
            AutopilotConfig(),
            flavour=chosen.flavour,
            noise=chosen.noise,
            seed=chosen.seed,
            remote_port=chosen.remote_port,
            operator_port=chosen.operator_port,
            tcp_port=chosen.tcp_port,
        )
    truth = TruthRing.attach(chosen.truth) if chosen.truth else None
    server = AutopilotServer(config, truth)
    try:
        run_program(server, asdict(server.ports), orders=chosen.control)
    finally:
        if truth is not None:
            truth.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
