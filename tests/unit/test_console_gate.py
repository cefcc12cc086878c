"""Who may see and use the console, asked of the real server with raw clients."""

from __future__ import annotations

import base64
import http.client
import logging
import re
import ssl
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser
import websockets.asyncio.server
from websockets import InvalidStatus, Origin, Subprotocol
from websockets.sync.client import connect

from common.cli import main
from common.config import ConfigError, build
from ground.console.config import ConsoleConfig
from ground.console.gate import SESSION_S, Sessions, TryLimit
from ground.console.password import make_hash, write_hash
from ground.console.server import PageServer, open_server
from tests.machine import free_port

PASSWORD = "the limiter comes last ü"


class Client:
    """Raw HTTP and websocket client of a console on 0.0.0.0, reached through 127.0.0.1."""

    def __init__(self, port: int, tls: ssl.SSLContext | None = None):
        self.port, self.tls = port, tls

    def get(self, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
        """Status, headers and text of the answer to a GET."""
        if self.tls is None:
            link = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        else:
            link = http.client.HTTPSConnection("127.0.0.1", self.port, timeout=10, context=self.tls)
        try:
            link.request("GET", path, headers=headers)
            answer = link.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read().decode()
        finally:
            link.close()

    def handshake(self, origin: str | None = None, **headers: str) -> int:
        """Status of a websocket's handshake; 101 only once a first message of the page has come."""
        scheme = "wss" if self.tls else "ws"
        try:
            with connect(
                f"{scheme}://127.0.0.1:{self.port}",
                origin=Origin(origin) if origin else None,
                subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
                additional_headers=headers,
                ssl=self.tls,
                proxy=None,
            ) as page:
                assert page.recv(timeout=10)
                return 101
        except InvalidStatus as refused:
            return refused.response.status_code


def basic(password: str) -> str:
    """Credentials as HTTP basic sends them."""
    return "Basic " + base64.b64encode(f"operator:{password}".encode()).decode()


@pytest.fixture
def password_file(tmp_path: Path) -> str:
    path = tmp_path / "password"
    write_hash(path, make_hash(PASSWORD))
    return str(path)


@pytest.fixture
def client(password_file: str) -> Iterator[Client]:
    port = free_port()
    origins = ("https://console.example",)
    server = open_server(ConsoleConfig(host="0.0.0.0", port=port, password_file=password_file, origins=origins), "test")
    yield Client(port)
    server.stop()


def test_without_the_password_there_is_a_login_page_and_nothing_else(client: Client) -> None:
    status, headers, text = client.get("/")

    assert status == 401
    assert "Password" in text
    assert "viser" not in text.lower()
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Frame-Options"] == "DENY"
    assert "WWW-Authenticate" not in headers, "the browser's own dialogue would cover the page"
    assert client.get("/index.html")[0] == client.get("/assets/../index.html")[0] == client.get("/login")[0] == 401
    assert client.get("/", Upgrade="websocket")[0] == 401


def test_websocket_without_credentials_is_refused_in_its_handshake(client: Client) -> None:
    own = f"http://127.0.0.1:{client.port}"

    assert client.handshake() == client.handshake(origin=own) == 401
    assert client.handshake(Authorization="Basic ?") == client.handshake(Authorization="Bearer abc") == 401
    assert client.handshake(Cookie=f"outrider-console-{client.port}=1.2.3") == 401
    assert client.handshake(Cookie=f"outrider-console-{client.port}=4102444800.00.") == 401


def test_program_with_the_password_gets_page_and_websocket(client: Client) -> None:
    status, headers, text = client.get("/", Authorization=basic(PASSWORD))

    assert status == 200
    assert "<script" in text
    assert headers["X-Frame-Options"] == "DENY"
    assert client.handshake(Authorization=basic(PASSWORD)) == 101


def test_login_gives_a_session_that_opens_page_and_websocket(client: Client) -> None:
    own = f"http://127.0.0.1:{client.port}"
    status, headers, _ = client.get("/login", Authorization=basic(PASSWORD), Origin=own)
    cookie, _, flags = headers["Set-Cookie"].partition(";")

    assert status == 200
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= {flag.strip() for flag in flags.split(";")}
    assert client.get("/", Cookie=f"other=1; {cookie}")[0] == 200
    assert client.handshake(origin=own, Cookie=cookie) == 101
    assert client.handshake(origin=own, Cookie=cookie[:-1] + ("0" if cookie[-1] != "0" else "1")) == 401


def test_foreign_origin_is_refused_even_with_the_password_and_a_listed_one_is_not(client: Client) -> None:
    credentials = {"Authorization": basic(PASSWORD)}

    assert client.handshake(origin="https://evil.example", **credentials) == 403
    assert client.handshake(origin=f"http://127.0.0.1:{client.port + 1}", **credentials) == 403
    assert client.get("/login", Origin="https://evil.example", **credentials)[0] == 403
    assert client.handshake(origin="https://console.example", **credentials) == 101
    assert client.handshake(origin="https://console.example") == 401


def test_guessing_is_logged_and_slowed_down_and_a_session_is_not_touched(
    client: Client, caplog: pytest.LogCaptureFixture
) -> None:
    cookie = client.get("/login", Authorization=basic(PASSWORD))[1]["Set-Cookie"].partition(";")[0]
    with caplog.at_level(logging.WARNING):
        answers = [client.get("/login", Authorization=basic(f"wrong password {i}")) for i in range(4)]

    assert [status for status, _, _ in answers] == [401, 401, 401, 429]
    assert answers[3][1]["Retry-After"] in ("1", "2")
    assert "wrong password from 127.0.0.1, 3 lately" in caplog.text
    assert PASSWORD not in caplog.text
    assert "wrong password 1" not in caplog.text
    assert client.get("/login", Authorization=basic(PASSWORD))[0] == 429, "the right one has to wait as well"
    assert client.get("/", Cookie=cookie)[0] == 200


def test_page_over_tls(tmp_path: Path, password_file: str) -> None:
    key, certificate, port = tmp_path / "key.pem", tmp_path / "certificate.pem", free_port()
    make = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=console"
    names = ["-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(certificate)]
    subprocess.run([*make.split(), *names], check=True, capture_output=True)
    config = ConsoleConfig(
        host="0.0.0.0", port=port, password_file=password_file, tls_certificate=str(certificate), tls_key=str(key)
    )
    server = open_server(config, "test")
    try:
        client = Client(port, ssl.create_default_context(cafile=str(certificate)))
        assert "Secure" in client.get("/login", Authorization=basic(PASSWORD))[1]["Set-Cookie"]
        assert client.handshake(origin=f"https://127.0.0.1:{port}", Authorization=basic(PASSWORD)) == 101
    finally:
        server.stop()


def test_certificate_that_cannot_be_used_is_one_clear_line(tmp_path: Path) -> None:
    empty = tmp_path / "empty.pem"
    empty.touch()
    for path in (str(empty), str(tmp_path / "none.pem")):
        with pytest.raises(ConfigError, match=r"console\.tls_certificate.*cannot be used") as refused:
            open_server(ConsoleConfig(port=free_port(), tls_certificate=path, tls_key=path), "test")
        assert "\n" not in str(refused.value)


def test_viser_that_opens_its_server_otherwise_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    serve = websockets.asyncio.server.serve
    monkeypatch.setattr(PageServer, "__init__", lambda *_, **__: None)

    with pytest.raises(ConfigError, match=re.escape(f"viser {viser.__version__} opens its server in a way")):
        open_server(ConsoleConfig(port=free_port()), "test")
    assert websockets.asyncio.server.serve is serve


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "ground.lan"])
def test_address_that_others_reach_needs_a_password(host: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ground", "--set", f"console.host={host}"]) == 2

    said = capsys.readouterr().err
    assert f"[console]: host: got '{host}', which others can reach, without a password" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("origins", ["console.example"], "origins: got 'console.example'"),
        ("origins", ["https://console.example/"], "no path"),
        ("tls_key", "key.pem", "expected both or neither"),
    ],
)
def test_bad_access_settings_are_refused(key: str, value: object, text: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(text)):
        build(ConsoleConfig, {key: value}, "test")


def test_wait_doubles_up_to_a_minute_for_each_address_by_itself() -> None:
    limit = TryLimit()
    waits = []
    for _ in range(12):
        limit.failed("10.0.0.1", 100.0)
        waits.append(limit.wait_s("10.0.0.1", 100.0))

    assert waits == [0, 0, 1, 2, 4, 8, 16, 32, 60, 60, 60, 60]
    assert limit.wait_s("10.0.0.1", 161.0) == 0
    assert limit.wait_s("10.0.0.2", 100.0) == 0
    assert limit.failed("10.0.0.1", 2000.0) == 1, "forgotten after a quarter of an hour"
    limit.failed("10.0.0.1", 2000.0)
    limit.passed("10.0.0.1")
    assert limit.failed("10.0.0.1", 2000.0) == 1


def test_addresses_of_one_ipv6_network_count_together_and_memory_is_bounded() -> None:
    limit = TryLimit()
    for i in range(3):
        limit.failed(f"fd00::{i}", 0.0)

    assert limit.wait_s("fd00::99", 0.0) == 1
    assert limit.wait_s("fd00:0:0:1::1", 0.0) == 0
    for i in range(3000):
        limit.failed(f"10.0.{i // 256}.{i % 256}", 0.0)
    assert len(limit._failed) == 1024


def test_session_expires_and_ends_with_the_password() -> None:
    sessions = Sessions(b"key")
    token = sessions.token(1000.0)

    assert sessions.valid(token, 1000.0 + SESSION_S - 1)
    assert Sessions(b"key").valid(token, 1001.0), "after a restart of the console too"
    assert not sessions.valid(token, 1001.0 + SESSION_S)
    assert not Sessions(b"another").valid(token, 1001.0)
    later = "9" + token
    assert not any(sessions.valid(forged, 1001.0) for forged in ("", "..", later, token + "0", token.split(".")[0]))
