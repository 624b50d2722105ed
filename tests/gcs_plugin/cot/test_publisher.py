"""Events reach a device by UDP and a server by TCP, again and again until they are stale."""

from __future__ import annotations

import queue
import shutil
import socket
import ssl
import subprocess
import threading
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import pytest

from gcs_plugin.cot.publisher import TakPublisher
from gcs_plugin.cot.sender import ServerSender, UdpSender, cot_sender
from mission.camera import Camera, Mounting
from mission.errors import SettingsError
from mission.settings import TakSettings
from tests.support.sample import NOON, geotag

CAMERA = Camera.from_field_of_view(640, 480, 1.2, Mounting.tilted(0.1))


class Kept:
    """A sender that keeps what it was given."""

    def __init__(self) -> None:
        self.events: queue.Queue[bytes] = queue.Queue()
        self.closed = False

    def send(self, event: bytes) -> None:
        self.events.put(event)

    def close(self) -> None:
        self.closed = True

    def next_type(self, timeout_s: float = 5.0) -> str:
        return ET.fromstring(self.events.get(timeout=timeout_s)).get("type", "")


@pytest.fixture
def sink() -> Iterator[socket.socket]:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.settimeout(5.0)
        yield opened


def test_a_target_reaches_a_device_by_udp_with_its_ellipse(sink: socket.socket) -> None:
    url = f"udp://127.0.0.1:{sink.getsockname()[1]}"
    with closing(TakPublisher(TakSettings(urls=(url,)), CAMERA, "1")) as publisher:
        publisher.target(geotag())
        types = {ET.fromstring(sink.recv(65535)).get("type") for _ in range(2)}
    assert types == {"a-u-G", "u-d-f"}


def test_a_multicast_goes_out_of_the_interface_that_is_named() -> None:
    group = "239.2.3.1"
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as member:
        member.bind(("", 0))
        member.settimeout(5.0)
        member.setsockopt(
            socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + socket.inet_aton("127.0.0.1")
        )
        with closing(UdpSender(group, member.getsockname()[1], "127.0.0.1")) as sender:
            sender.send(b"<event/>")
            assert member.recv(100) == b"<event/>"


def test_it_is_sent_again_until_it_is_stale() -> None:
    kept = Kept()
    now = [NOON]
    settings = TakSettings(repeat_s=0.51, stale_moving_s=2.0)
    with closing(TakPublisher(settings, CAMERA, "1", utc=lambda: now[0], senders=[kept])) as publisher:
        publisher.target(geotag())
        assert [kept.next_type() for _ in range(4)] == ["a-u-G", "u-d-f"] * 2
        now[0] += timedelta(seconds=3)
        while True:  # what was on its way
            try:
                kept.next_type(1.2)
            except queue.Empty:
                break
    assert kept.closed


def test_a_better_answer_for_the_same_target_replaces_the_first() -> None:
    kept = Kept()
    with closing(TakPublisher(TakSettings(repeat_s=0.51), CAMERA, "1", utc=lambda: NOON, senders=[kept])) as publisher:
        for _ in range(3):
            publisher.target(geotag())
        first = [kept.next_type() for _ in range(6)]
        again = [kept.next_type() for _ in range(2)]
    assert first == ["a-u-G", "u-d-f"] * 3
    assert again == ["a-u-G", "u-d-f"]


class Server:
    """A TAK server as far as it listens."""

    def __init__(self) -> None:
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.socket.settimeout(10.0)
        self.url = f"tcp://127.0.0.1:{self.socket.getsockname()[1]}"

    def event(self, connection: socket.socket) -> ET.Element:
        content = b""
        connection.settimeout(10.0)
        while b"</event>" not in content:
            content += connection.recv(4096)
        return ET.fromstring(content.split(b"?>", 1)[1].split(b"</event>")[0] + b"</event>")


def test_a_server_gets_the_events_and_is_found_again_when_it_was_lost() -> None:
    server = Server()
    event = b'<?xml version="1.0"?><event uid="a"></event>'
    with closing(server.socket), closing(ServerSender(server.url, TakSettings())) as sender:
        connection, _ = server.socket.accept()
        sender.send(event)
        assert server.event(connection).get("uid") == "a"
        connection.close()
        connection, _ = server.socket.accept()
        with closing(connection):
            sender.send(event)
            assert server.event(connection).get("uid") == "a"


@pytest.mark.skipif(shutil.which("openssl") is None, reason="OpenSSL's program makes the certificates")
def test_a_server_over_tls_knows_us_by_our_certificate(tmp_path: Path) -> None:
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    subprocess.run(
        [
            "openssl",
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:prime256v1",
            "-nodes",
            "-days",
            "2",
            "-subj",
            "/CN=localhost",
            "-addext",
            "subjectAltName=DNS:localhost,IP:127.0.0.1",
            "-keyout",
            str(key),
            "-out",
            str(certificate),
        ],
        check=True,
        capture_output=True,
        timeout=60,
    )
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=str(certificate))
    context.load_cert_chain(certificate, key)
    context.verify_mode = ssl.CERT_REQUIRED
    server = Server()
    settings = TakSettings(certificate=certificate, key=key, authority=certificate)
    with closing(server.socket), closing(ServerSender(server.url.replace("tcp", "tls"), settings)) as sender:
        sender.send(b'<?xml version="1.0"?><event uid="secret"></event>')
        plain, _ = server.socket.accept()
        with context.wrap_socket(plain, server_side=True) as connection:
            assert connection.getpeercert()
            assert server.event(connection).get("uid") == "secret"


def test_a_server_that_is_not_there_keeps_nobody_waiting() -> None:
    with closing(socket.create_server(("127.0.0.1", 0))) as free:
        url = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    sender = ServerSender(url, TakSettings())
    for _ in range(1000):
        sender.send(b"<event/>")
    ended = threading.Thread(target=sender.close)
    ended.start()
    ended.join(5.0)
    assert not ended.is_alive()


def test_addresses_that_cannot_be_used_are_told() -> None:
    with pytest.raises(SettingsError):
        cot_sender("udp://127.0.0.1:99999", TakSettings())
    with pytest.raises(SettingsError, match="interface"):
        UdpSender("239.2.3.1", 6969, "nonsense")
