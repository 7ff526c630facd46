"""What may be asked of the server of the page: the page itself, from this machine, by its own script.

A browser runs pages of strangers, too, and these can reach every port of this machine. So a request is refused

* whose Host header is not this address (a stranger's name that was made to point here: DNS rebinding),
* whose Origin header, if it has one, is not this page: a websocket is open to every page, if the server lets it,
* for any path other than the page: there are no other files here,

and the page is sent with a policy by which its script may talk to this address only.
"""

from __future__ import annotations

from collections.abc import Callable
from http import HTTPStatus
from typing import Any

# Names of this machine, in Host and Origin headers.
_NAMES = ("127.0.0.1", "localhost")
# The script of the page is one file in the page: it unpacks itself, and has workers of its own.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; connect-src {addresses} data: blob:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_PAGE = ("/", "/index.html")


class Guard:
    """Judges the requests to a server at 127.0.0.1 and this port."""

    def __init__(self, port: int) -> None:
        self.hosts = {f"{name}:{port}" for name in _NAMES}
        if port == 80:
            self.hosts |= set(_NAMES)
        self.origins = {f"http://{host}" for host in self.hosts}
        addresses = [f"{scheme}://{host}" for scheme in ("http", "ws") for host in sorted(self.hosts)]
        self.headers = {
            "Content-Security-Policy": _POLICY.format(addresses=" ".join(addresses)),
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-store",
        }

    def refusal(self, path: str, headers: Any) -> tuple[HTTPStatus, str] | None:
        """Why a request is refused; None if it is not. headers: with `get_all`."""
        if [host.lower() for host in headers.get_all("Host")] not in ([own] for own in self.hosts):
            return HTTPStatus.FORBIDDEN, "this address is not served here"
        origins = headers.get_all("Origin")
        websocket = "websocket" in ",".join(headers.get_all("Upgrade")).lower()
        if any(origin.lower() not in self.origins for origin in origins) or (websocket and not origins):
            return HTTPStatus.FORBIDDEN, "only the page of this server may connect"
        if path.partition("?")[0] not in _PAGE:
            return HTTPStatus.NOT_FOUND, "there is no such page"
        return None

    def around(self, process: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        """A `process_request` of websockets that judges before the given one answers."""

        def guarded(connection: Any, request: Any) -> Any:
            refused = self.refusal(request.path, request.headers)
            if refused is not None:
                status, sentence = refused
                return connection.respond(status, f"{sentence}\n")
            response = process(connection, request)
            if response is not None:
                for name, value in self.headers.items():
                    response.headers[name] = value
            return response

        return guarded
