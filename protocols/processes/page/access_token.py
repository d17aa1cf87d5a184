"""Which requests a page answers: those with its token, from its own pages, at its own address."""

import hmac
import secrets
from dataclasses import dataclass, replace
from typing import Self

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "default-src 'self'; img-src 'self' blob: data:; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


@dataclass(frozen=True, slots=True)
class AccessRule:
    """What a request must have: the token as the first part of its path, our Host, our Origin.

    A page of somebody else's, in the same browser, has neither the token nor our Origin; a name
    that somebody else points at the loopback address is none of our hosts.
    """

    token: str
    port: int

    def narrowed(self, name: str) -> Self:
        """Return the rule of one part of a page, whose address tells nothing of the token."""
        key = hmac.new(self.token.encode(), name.encode(), "sha256").hexdigest()
        return replace(self, token=key)

    def admits(self, *, method: str, path: str, headers: Headers) -> bool:
        """Return whether a request is answered; one that changes something must name its origin."""
        token = path.split("/", 2)[1] if path.startswith("/") else ""
        known = secrets.compare_digest(token.encode(), self.token.encode())
        hosts = [f"{name}:{self.port}" for name in ("127.0.0.1", "localhost")]
        origin = headers.get("origin")
        silent = origin is None and method in ("GET", "HEAD")
        ours = silent or origin in [f"http://{host}" for host in hosts]
        return known and headers.get("host") in hosts and ours

    def guard(self, app: ASGIApp) -> ASGIApp:
        """Return an application that hands to ``app`` what is admitted, without the token.

        What an answer says of its own headers counts; the others are ``HEADERS``.
        """

        async def guarded(scope: Scope, receive: Receive, send: Send) -> None:
            if scope["type"] != "http":
                return
            path, headers = scope["path"], Headers(scope=scope)
            if not self.admits(method=scope["method"], path=path, headers=headers):
                await PlainTextResponse("refused\n", 403)(scope, receive, send)
                return

            async def sending(message: Message) -> None:
                if message["type"] == "http.response.start":
                    answered = MutableHeaders(scope=message)
                    for name, value in HEADERS.items():
                        answered.setdefault(name, value)
                await send(message)

            await app({**scope, "path": path[len(self.token) + 1 :]}, receive, sending)

        return guarded
