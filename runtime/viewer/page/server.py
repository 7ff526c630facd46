"""The server of the page: viser, bound to this machine alone and behind a guard (`guard.py`).

This is the one module that changes how viser serves: its sockets, its answers, its uploads, and its offer to share a
page through a server of its own.
"""

from __future__ import annotations

import contextlib
import io
import logging
import socket
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from softprint.runtime.errors import SoftprintError
from softprint.runtime.viewer.page.guard import Guard

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
LARGEST_UPLOAD = 32 << 20  # bytes
# One message of a browser may have so many bytes: a part of an upload has a few hundred thousand.
_LARGEST_MESSAGE = 4 << 20

log = logging.getLogger(__name__)
_serving = threading.Lock()


def bound_socket(port: int) -> socket.socket:
    """A socket at 127.0.0.1 and this port, or any free one for port 0. Raises SoftprintError where it is taken."""
    if not 0 <= port < 1 << 16:
        raise SoftprintError(f"a port is a number from 0 to 65535, not {port}")
    own = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        own.bind((HOST, port))
        own.listen(64)
    except OSError as error:
        own.close()
        raise SoftprintError(
            f"port {port} cannot be used ({error.strerror}), perhaps because another `softprint view` has it: choose "
            "another with --port, or any free one with --port 0"
        ) from error
    return own


def check_port(port: int) -> None:
    """Raises SoftprintError where a port cannot be used, before any long work."""
    bound_socket(port).close()


def start_server(port: int, label: str) -> viser.ViserServer:
    """A viser server at 127.0.0.1; `get_port()` says where. Raises SoftprintError where viser is missing or the port is
    taken."""
    try:
        import viser
    except ImportError as error:
        raise SoftprintError("the window needs viser: pip install 'softprint[view]'") from error
    for chatty in ("websockets", "websockets.server", "asyncio"):
        logging.getLogger(chatty).setLevel(logging.CRITICAL)
    own = bound_socket(port)
    with _serving, _guarded(own), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(HOST, own.getsockname()[1], label=label, verbose=False)
    _close_doors(server)
    return server


def stop_server(server: viser.ViserServer) -> None:
    """End a server; browsers keep showing what they have."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


@contextlib.contextmanager
def _guarded(own: socket.socket) -> Iterator[None]:
    """Inside the block, a websockets server listens at this socket, behind a guard. viser starts its server within its
    constructor and lets nobody in between, hence this exchange of the function that it calls."""
    import websockets.asyncio.server as asyncio_server

    serve, guard = asyncio_server.serve, Guard(own.getsockname()[1])

    def guarded(handler: Any, host: str, port: int, *, process_request: Any, **settings: Any) -> Any:
        settings["max_size"] = _LARGEST_MESSAGE
        return serve(handler, sock=own, process_request=guard.around(process_request), **settings)

    asyncio_server.serve = guarded
    try:
        yield
    finally:
        asyncio_server.serve = serve


def _close_doors(server: viser.ViserServer) -> None:
    """No sharing through a server elsewhere, and no upload without a limit."""
    from viser import _messages

    connection = server._websock_server
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        connection.unregister_handler(message)
    gui = server.gui
    begin, part = gui._handle_file_transfer_start, gui._handle_file_transfer_part

    def bounded_begin(client: Any, message: Any) -> None:
        small = 0 <= message.size_bytes <= LARGEST_UPLOAD and 0 <= message.part_count <= 1 << 12
        if small and len(gui._current_file_upload_states) < 4:
            begin(client, message)
            return
        log.warning("an upload was refused: a file has at most %d MB", LARGEST_UPLOAD >> 20)

    def bounded_part(client: Any, message: Any) -> None:
        state = gui._current_file_upload_states.get(message.transfer_uuid)
        if state is not None and state["transferred_bytes"] + len(message.content) > LARGEST_UPLOAD:
            gui._current_file_upload_states.pop(message.transfer_uuid, None)
            return
        part(client, message)

    for kind, handler in (
        (_messages.FileTransferStartUpload, bounded_begin),
        (_messages.FileTransferPart, bounded_part),
    ):
        connection.unregister_handler(kind)
        connection.register_handler(kind, handler)
