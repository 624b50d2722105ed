"""A standard output that is full or gone costs its text and nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs_plugin.terminal.output import LastingOutput
from mission.vehicle.pilot.loopback import loopback_socket

SERVE = [sys.executable, "-m", "gcs_plugin", "serve"]


def test_text_is_written_and_what_the_encoding_lacks_is_a_question_mark(tmp_path: Path) -> None:
    with (tmp_path / "out").open("wb") as file:
        output = LastingOutput(file.fileno(), "ascii")
        output.write("5 m ±1\n")
        output.write("6 m\n")
        assert output.drain(10.0)
        assert (tmp_path / "out").read_bytes() == b"5 m ?1\n6 m\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a full disk to try on")
def test_a_full_disk_costs_the_text_alone() -> None:
    with Path("/dev/full").open("wb") as file:
        output = LastingOutput(file.fileno())
        assert output.write("lost") == 4
        assert output.drain(10.0)
        assert output.lost == 4


def test_a_closed_pipe_costs_the_text_alone() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    output = LastingOutput(writer)
    output.write("lost")
    assert output.drain(10.0)
    os.close(writer)
    assert output.lost == 4


def test_a_pipe_that_nobody_reads_holds_up_nothing() -> None:
    reader, writer = os.pipe()
    output = LastingOutput(writer)
    began_s = time.monotonic()
    for _ in range(3000):
        output.write("a line of the flight's progress" * 20 + "\n")
    assert time.monotonic() - began_s < 10.0
    assert output.lost > 0
    assert not output.drain(0.1)
    os.close(reader)  # the writer gives up what it holds
    assert output.drain(10.0)
    os.close(writer)


PRINTING = """
from gcs_plugin.terminal.output import lasting_console
lasting_console().print("the last word")
"""


def test_what_was_said_last_is_there_at_the_end_of_the_program() -> None:
    done = subprocess.run([sys.executable, "-c", PRINTING], check=True, capture_output=True, text=True, timeout=60.0)
    assert done.stdout == "the last word\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has a full disk to try on")
@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_serve_goes_on_without_its_output_and_ends_in_order_when_asked(tmp_path: Path, ending: signal.Signals) -> None:
    with loopback_socket() as sock:
        port = sock.getsockname()[1]
    (tmp_path / "s.toml").write_text("[link]\nconnect_timeout_s = 1.0\n")
    arguments = ["--settings", "s.toml", "--link", f"udpin://127.0.0.1:{port}", "--folder", str(tmp_path)]
    with Path("/dev/full").open("wb") as full, (tmp_path / "said").open("wb") as said:
        service = subprocess.Popen([*SERVE, *arguments], stdout=full, stderr=said, cwd=tmp_path)
        try:
            deadline = time.monotonic() + 60.0
            # the second pilot process: it has said that the first found nobody, and connects again
            while (tmp_path / "said").read_bytes() == b"" and service.poll() is None and time.monotonic() < deadline:
                log = tmp_path / "pilot.log"
                if log.exists() and log.read_text(errors="replace").count("MAVSDK version") >= 2:
                    break
                time.sleep(0.1)  # looks again until the deadline
            assert service.poll() is None, (tmp_path / "said").read_text()
            asked_s = time.monotonic()
            service.send_signal(ending)
            assert service.wait(20.0) == 0
            assert time.monotonic() - asked_s < 10.0
        finally:
            service.kill()
            service.wait()
    assert (tmp_path / "said").read_text() == ""
