"""Access control of a workbench: the host names it answers to, the origins it accepts, the tokens, and the roles.

Another web site cannot read what 127.0.0.1 serves, but it can try: by a name of its own that it points at 127.0.0.1
(DNS rebinding), or by a WebSocket, which browsers open across sites. The headers of a request show both.
"""

import hashlib
import hmac
import os
import re
import secrets
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from http import HTTPStatus
from ipaddress import ip_address
from typing import Literal
from urllib.parse import parse_qs, urlsplit

from simaps_viz.errors import InputError

TOKEN_VARIABLE, OWNER_VARIABLE = "SIMAPS_TOKEN", "SIMAPS_OWNER_TOKEN"
MIN_TOKEN = 16
"""Characters of a token that a person chooses."""
MAX_PATH = 2048
"""Characters of an address."""
MAX_WRONG, FORGET_S, MAX_ADDRESSES = 10, 60.0, 1024
"""Wrong tokens of one address within so many seconds before no more are looked at; addresses that are remembered."""
MAX_INSIDE = 256
"""Browsers that are let in at once; the one not seen for longest has to bring the token again."""

Refusal = tuple[HTTPStatus, str]

Role = Literal["owner", "visitor"]
Right = Literal["edit", "drive"]
"""edit: change or stop what is kept on the server (mend the map, rename, delete and restore files, save answers, stop a
build). drive: move a real robot. To look, to ask and to simulate needs no right."""
RIGHTS: Mapping[Role, frozenset[Right]] = {"owner": frozenset({"edit", "drive"}), "visitor": frozenset()}

SAFE_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=(), usb=(), serial=()",
}
"""Sent with everything that is served."""

ENTERED = (
    '<!doctype html><html lang="en"><meta http-equiv="refresh" content="0;url={path}"><title>SI Maps</title></html>'
)
"""Sent to whoever brings the token in the address: continues without it, so that the address bar does not keep it."""
ENTERED_CSP = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"


def is_loopback(host: str) -> bool:
    """Return whether an address can only be reached from this machine."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def bracketed(host: str) -> str:
    """Write a host as addresses have it: ``[::1]``."""
    return f"[{host}]" if ":" in host else host


def name_of(host_header: str | None) -> str | None:
    """Return the name in a Host header, in lower case, without its port; None if it is not a name."""
    match = re.fullmatch(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]{1,253})(:\d{1,5})?", (host_header or "").lower())
    return None if match is None else match[1]


def headers_of(pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Return headers by their names in lower case; one that comes twice is joined, so that it matches nothing."""
    found: dict[str, str] = {}
    for name, value in pairs:
        key = name.lower()
        found[key] = f"{found[key]}, {value}" if key in found else value
    return found


class Access:
    """The rules of one workbench."""

    def __init__(
        self,
        host: str = "127.0.0.1",
        *,
        token: str | None = None,
        allow_edit: bool = False,
        read_only: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the access control of a server.

        Who brings `owner_token` is an owner, everybody else a visitor. Where there is none, all are owners, or
        visitors if ``read_only``.

        Args:
            host: address to listen on.
            token: required of every client; by default SIMAPS_TOKEN, and where that is empty a new one, or none
                when only this machine can reach the address and nobody is set apart by an owner's token.
            allow_edit: make everybody an owner.
            read_only: make everybody a visitor.
            clock: seconds.

        Raises:
            InputError: a token is too short, or has characters that addresses do not; or everybody is to be both.
        """
        if allow_edit and read_only:
            raise InputError("expected one of --allow-edit and --read-only, found both")
        chosen = _checked(TOKEN_VARIABLE, os.environ.get(TOKEN_VARIABLE, "") if token is None else token)
        owners = _checked(OWNER_VARIABLE, os.environ.get(OWNER_VARIABLE, ""))
        self.host = host = "127.0.0.1" if host == "localhost" else host
        self.read_only = read_only
        self.owner_token = ""
        """Makes an owner of who brings it; empty where all have the same role."""
        if not allow_edit and not read_only:
            self.owner_token = owners or (secrets.token_urlsafe(32) if self.is_open else "")
        self.token = chosen or (secrets.token_urlsafe(32) if self.is_open or self.owner_token else "")
        """Lets in who brings it; empty where everybody may come in."""
        if self.token and self.token == self.owner_token:
            raise InputError(f"{OWNER_VARIABLE}: expected another token than {TOKEN_VARIABLE}, found the same")
        self._guessable = {chosen, owners}
        self.cookie = f"simaps-{secrets.token_hex(8)}"
        self._names = {"localhost", "127.0.0.1", "[::1]", bracketed(host)}
        if self.is_open:
            here = socket.gethostname().lower()
            self._names |= {here, f"{here}.local"}
        self._clock, self._lock = clock, threading.Lock()
        self._wrong: OrderedDict[tuple[str, bool], list[float]] = OrderedDict()
        self._inside: OrderedDict[bytes, Role] = OrderedDict()

    @property
    def name(self) -> str:
        """The host name for a browser on this machine."""
        anywhere = {"": "127.0.0.1", "0.0.0.0": "127.0.0.1", "::": "[::1]"}
        return anywhere.get(self.host) or bracketed(self.host)

    @property
    def is_open(self) -> bool:
        """Whether other machines can reach it."""
        return not is_loopback(self.host)

    def refuse(
        self, headers: Mapping[str, str], path: str, *, own_address: str, peer: str, writes: bool = False
    ) -> Refusal | None:
        """Return the status and the reason with which a request is refused; None when it is answered.

        Args:
            headers: of the request, from `headers_of`.
            path: with its query.
            own_address: of this end of the connection, without a port.
            peer: address of the other end.
            writes: whether the request can change something: it opens a WebSocket, or is a POST.
        """
        if len(path) > MAX_PATH or not path.startswith("/"):
            return HTTPStatus.REQUEST_URI_TOO_LONG, "not an address of this server"
        if self._is_foreign(headers, own_address, writes):
            return HTTPStatus.FORBIDDEN, "this server answers its own page only"
        given, tries, inside = _token_in(path), (peer, _is_cross_site(headers)), self._inside_as(headers)
        guesses = inside == "visitor" and self.owner_token and given not in (None, self.token)
        if not self.token or (inside and not guesses):  # a client that was let in stays in, whatever others try
            return None
        may_try = self._may_try(tries)
        if self._bearer(given) and (may_try or given not in self._guessable):  # wrong tokens of others lock nobody out
            return None
        if not may_try:
            return HTTPStatus.TOO_MANY_REQUESTS, "too many wrong tokens; wait a minute"
        if given is not None:
            self._was_wrong(tries)
        return HTTPStatus.UNAUTHORIZED, "open the address with ?token=… that the terminal shows"

    def forgive(self) -> None:
        """Forget all wrong tokens."""
        with self._lock:
            self._wrong.clear()

    def entering(self, headers: Mapping[str, str], path: str) -> dict[str, str] | None:
        """Return the headers that let in whoever has the token in the address and no cookie yet.

        The cookie never holds the token: browsers send cookies to every port of a name, whoever serves there.
        """
        role, known = self._bearer(_token_in(path)), self._inside_as(headers)
        if role is None or known in (role, "owner"):
            return None
        pass_ = secrets.token_urlsafe(32)
        with self._lock:
            self._inside[_digest(pass_)] = role
            while len(self._inside) > MAX_INSIDE:  # visitors do not push an owner out
                del self._inside[next((d for d, r in self._inside.items() if r == "visitor"), next(iter(self._inside)))]
        return {"Set-Cookie": f"{self.cookie}={pass_}; HttpOnly; SameSite=Strict; Path=/"}

    def role(self, headers: Mapping[str, str], path: str) -> Role:
        """Return the role of a client whose request, of these headers and this path, `refuse` lets in."""
        if not self.owner_token:
            return "visitor" if self.read_only else "owner"
        return "owner" if "owner" in (self._inside_as(headers), self._bearer(_token_in(path))) else "visitor"

    def _is_foreign(self, headers: Mapping[str, str], own_address: str, writes: bool) -> bool:
        host, origin = headers.get("host"), headers.get("origin")
        name = name_of(host)
        if name is None or name not in self._names | {bracketed(own_address.removeprefix("::ffff:"))}:
            return True
        if origin is not None and origin.lower() not in (f"http://{host}".lower(), f"https://{host}".lower()):
            return True
        return _is_cross_site(headers) and (headers.get("sec-fetch-mode") != "navigate" or writes)

    def _inside_as(self, headers: Mapping[str, str]) -> Role | None:
        """Return the role of a browser by its cookie; None when it has not been let in."""
        pairs = (pair.strip().partition("=") for pair in headers.get("cookie", "").split(";"))
        given = [_digest(value) for name, _, value in pairs if name == self.cookie]  # others may have set more of them
        with self._lock:
            known = next((one for one in given if one in self._inside), None)
            if known is None:
                return None
            self._inside.move_to_end(known)
            return self._inside[known]

    def _bearer(self, given: str | None) -> Role | None:
        """Return the role of who brings a token; None when it is wrong."""
        digits = (given or "").encode(errors="replace")
        owner = bool(self.owner_token) and hmac.compare_digest(digits, self.owner_token.encode())
        visitor = bool(self.token) and hmac.compare_digest(digits, self.token.encode())
        return "owner" if owner else "visitor" if visitor else None

    def _may_try(self, tries: tuple[str, bool]) -> bool:
        with self._lock:
            times = [at for at in self._wrong.get(tries, ()) if self._clock() - at < FORGET_S]
            return len(times) < MAX_WRONG

    def _was_wrong(self, tries: tuple[str, bool]) -> None:
        """Count a wrong token. Those sent by pages of other sites are counted apart: their reader did not send them."""
        with self._lock:
            times = [*self._wrong.pop(tries, ()), self._clock()]
            self._wrong[tries] = times[-MAX_WRONG:]
            while len(self._wrong) > MAX_ADDRESSES:
                self._wrong.popitem(last=False)


def _is_cross_site(headers: Mapping[str, str]) -> bool:
    return headers.get("sec-fetch-site") == "cross-site"


def _checked(variable: str, token: str) -> str:
    """Return a token that a person chose, empty for none; raises InputError when it is too short or no token."""
    if token and not re.fullmatch(rf"[A-Za-z0-9_-]{{{MIN_TOKEN},200}}", token):
        raise InputError(f"{variable}: expected {MIN_TOKEN} to 200 letters, digits, - and _, found something else")
    return token


def _digest(given: str) -> bytes:
    """Return the digest that is kept of a cookie; the time to look it up reveals nothing about the cookie."""
    return hashlib.sha256(given.encode(errors="replace")).digest()


def _token_in(path: str) -> str | None:
    try:
        return parse_qs(urlsplit(path).query, max_num_fields=20).get("token", [None])[0]
    except ValueError:
        return None


def without_query(text: str) -> str:
    """Return a line for the log without the query, which may hold a token; its status stays, control characters do not.

    The token may contain what looks like the end of the address, so everything up to the end of the line is removed.
    """
    text = re.sub(r"[^ -~]", ".", text)
    return re.sub(r"\?.*?((?: HTTP/\d\.\d)?\" \d{3} \S+)?\Z", r"?…\1", text)
