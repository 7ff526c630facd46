"""What the server of the page answers, asked with raw requests, as a stranger's page or program would ask."""

from __future__ import annotations

import base64
import os
import socket
from types import SimpleNamespace

import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer.page.server import (
    LARGEST_UPLOAD,
    bound_socket,
    check_port,
    start_server,
    stop_server,
)


@pytest.fixture(scope="module")
def server():
    server = start_server(0, "guarded")
    yield server
    stop_server(server)


def answer(server, request: str) -> str:
    """The whole answer, or its beginning for a connection that stays open."""
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=10) as connection:
        connection.sendall(request.replace("PORT", str(server.get_port())).encode("latin-1"))
        parts = []
        try:
            while part := connection.recv(65536):
                parts.append(part)
                if b" 101 " in parts[0]:
                    break
        except TimeoutError:
            pass
        return b"".join(parts).decode("latin-1")


def get(server, path: str, host: str = "127.0.0.1:PORT", more: str = "") -> str:
    return answer(server, f"GET {path} HTTP/1.1\r\nHost: {host}\r\n{more}Connection: close\r\n\r\n")


def upgrade(server, headers: str, host: str = "127.0.0.1:PORT") -> str:
    key = base64.b64encode(os.urandom(16)).decode()
    return answer(
        server,
        f"GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Protocol: viser-v1.1.1\r\n"
        f"{headers}\r\n",
    )


def test_the_page_comes_with_its_policy(server):
    found = get(server, "/")
    assert found.startswith("HTTP/1.1 200")
    assert f"connect-src http://127.0.0.1:{server.get_port()}" in found
    assert "default-src 'none'" in found
    assert "frame-ancestors 'none'" in found
    assert "<title>" in found


def test_it_listens_on_this_machine_alone(server):
    listening = {sock.getsockname()[0] for sock in server_sockets(server)}
    assert listening == {"127.0.0.1"}


def server_sockets(server):
    """Every listening socket of this process with the port of the server."""
    port, found = server.get_port(), []
    for name in os.listdir("/proc/self/fd"):
        try:
            target = os.readlink(f"/proc/self/fd/{name}")
        except OSError:
            continue
        if target.startswith("socket:"):
            sock = socket.socket(fileno=os.dup(int(name)))
            with sock:
                own = sock.family == socket.AF_INET and sock.getsockname()
                if own and own[1] == port and sock.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                    found.append(SimpleNamespace(getsockname=lambda own=own: own))
    assert found
    return found


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/../../../../../../etc/passwd",
        "/%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/..%2f..%2f..%2fetc%2fpasswd",
        "/%252e%252e/etc/passwd",
        "/..\\..\\etc\\passwd",
        "/%5c..%5c..%5cetc%5cpasswd",
        "//etc/passwd",
        "/etc/passwd",
        "/./etc/passwd",
        "/index.html/../../../_viser.py",
        "/index.html%00.js",
        "/hdri/..",
        "file:///etc/passwd",
        "http://127.0.0.1/etc/passwd",
        "/?x=../../etc/passwd/",
    ],
)
def test_no_path_leads_out_of_the_page(server, path):
    found = get(server, path)
    assert "root:" not in found
    assert "import" not in found.partition("\r\n\r\n")[2][:200]
    status = found[:12]
    assert status == "HTTP/1.1 404" or (path.startswith("/?") and status == "HTTP/1.1 200")


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:PORT", "127.0.0.1", "127.0.0.1:1", "[::1]:PORT", ""]
)
def test_another_name_for_this_address_is_refused(server, host):
    """As with DNS rebinding: the browser believes that this is the stranger's server."""
    assert get(server, "/", host).startswith(("HTTP/1.1 403", "HTTP/1.1 400"))
    assert upgrade(server, "Origin: http://127.0.0.1:PORT\r\n", host).startswith(
        ("HTTP/1.1 403", "HTTP/1.1 400")
    )


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "https://127.0.0.1:PORT",
        "http://127.0.0.1",
        "http://127.0.0.1:1",
        "http://127.0.0.1:PORT.evil.example",
        "null",
        "file://",
    ],
)
def test_the_page_of_a_stranger_may_not_connect(server, origin):
    assert upgrade(server, f"Origin: {origin}\r\n").startswith("HTTP/1.1 403")
    assert get(server, "/", more=f"Origin: {origin}\r\n").startswith("HTTP/1.1 403")


def test_two_origins_and_none_are_refused_and_its_own_page_is_let_in(server):
    own = "Origin: http://127.0.0.1:PORT\r\n"
    assert upgrade(server, own + "Origin: http://evil.example\r\n").startswith("HTTP/1.1 403")
    assert upgrade(server, "").startswith("HTTP/1.1 403")
    assert upgrade(server, own).startswith("HTTP/1.1 101")
    assert upgrade(server, "Origin: http://localhost:PORT\r\n", "localhost:PORT").startswith("HTTP/1.1 101")


@pytest.mark.parametrize(
    "request_text",
    [
        "GET /\r\n\r\n",
        "POST / HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n",
        "\x00\x01\x02\r\n\r\n",
        "GET / HTTP/1.1\r\n\r\n",
    ],
)
def test_other_requests_get_no_page(server, request_text):
    assert not answer(server, request_text).startswith("HTTP/1.1 200")


def test_no_page_is_shared_through_a_server_elsewhere(server):
    from viser import _messages

    handlers = server._websock_server._incoming_handlers
    assert _messages.ShareUrlRequest not in handlers
    assert _messages.ShareUrlDisconnect not in handlers


def test_uploads_are_limited(server):
    from viser import _messages

    button = server.gui.add_upload_button("file")
    (begin,) = server._websock_server._incoming_handlers[_messages.FileTransferStartUpload]
    (part,) = server._websock_server._incoming_handlers[_messages.FileTransferPart]
    states = server.gui._current_file_upload_states

    def start(name: str, size: int, parts: int = 1):
        begin(
            0,
            _messages.FileTransferStartUpload(
                source_component_uuid=button._impl.uuid,
                transfer_uuid=name,
                filename="x.stl",
                mime_type="",
                part_count=parts,
                size_bytes=size,
            ),
        )

    start("large", LARGEST_UPLOAD + 1)
    start("negative", -1)
    start("parts", 10, 1 << 20)
    assert not states
    # One that says it is small, and is not.
    start("liar", 10, 100)
    for index in range(70):
        part(
            0,
            _messages.FileTransferPart(
                source_component_uuid=button._impl.uuid,
                transfer_uuid="liar",
                part_index=index,
                content=bytes(1 << 20),
            ),
        )
    assert not states
    for number in range(9):  # no more than a few at a time
        start(f"one_{number}", 10)
    assert len(states) <= 4
    button.remove()


def test_a_taken_port_is_one_clear_sentence(server):
    with pytest.raises(SoftprintError, match=r"port \d+ cannot be used .*--port 0"):
        bound_socket(server.get_port())
    with pytest.raises(SoftprintError, match="0 to 65535"):
        check_port(70_000)
