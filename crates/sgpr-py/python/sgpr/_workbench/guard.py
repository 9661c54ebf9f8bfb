"""Who may talk to the server: pages that it served itself, with the token, and nobody else."""

import hmac
from urllib.parse import parse_qs

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
}
OPEN = "/assets/"
"""Below it are files of the package, the same for everybody; browsers ask for them without the token."""


class Guard:
    """Refuses other hosts (a name that was rebound to this machine), other origins, and whoever has no token."""

    def __init__(self, app: ASGIApp, *, token: str, port: int) -> None:
        self.app = app
        self.token = token.encode()
        self.hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
        self.origins = {f"http://{host}" for host in self.hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers itself, or lets the application answer."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = {**HEADERS} if scope["path"].startswith(OPEN) else {**HEADERS, "cache-control": "no-store"}
                message["headers"] += [(key.encode(), value.encode()) for key, value in extra.items()]
            await send(message)

        refusal = self._refusal(scope)
        app = self.app if refusal is None else PlainTextResponse(refusal, status_code=403)
        await app(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> str | None:
        headers = {key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]}
        if headers.get("host") not in self.hosts:
            return "refused: this server answers to 127.0.0.1 and localhost only"
        origin = headers.get("origin")
        if origin is not None and origin not in self.origins:
            return "refused: asked by a page of another origin"
        # A link from elsewhere may open the page if it knows the token, but nothing else.
        opens = scope["method"] == "GET" and scope["path"] == "/"
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none") and not opens:
            return "refused: asked by a page of another site"
        if scope["path"].startswith(OPEN):
            return None
        asked = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        given = headers.get("x-sgpr-token", asked)
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self.token):
            return "refused: the address needs its token; use the one that `sgpr workbench` printed"
        return None
