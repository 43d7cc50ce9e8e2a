"""Attacks over HTTP: other names, other sites, paths out of the folder, tokens, and requests that are none."""

from urllib.parse import quote

from attacks.target import (
    CAMERA,
    PAGES,
    Reply,
    Target,
    Tries,
    ask,
    enter,
    hung_up,
    open_socket,
    page,
    say,
    send_raw,
    socket_refused,
)
from websockets.exceptions import InvalidHandshake

EVIL = (
    "http://evil.example", "https://evil.example", "null", "http://127.0.0.1:1", "http://127.0.0.1.evil.example",
    "http://evil.example#127.0.0.1", "file://", "http://127.0.0.1@evil.example", "chrome-extension://abc",
)  # fmt: skip


def answered(reply: Reply, what: str) -> str | None:
    """Report an answer where there should have been none."""
    return f"{what} was answered" if 200 <= reply.status < 300 else None


def other_host_names(target: Target) -> Tries:
    """DNS rebinding: a page of another site asks by a name that it has pointed at this machine."""
    port = target.port
    for host in ("evil.example", f"evil.example:{port}", f"127.0.0.1.evil.example:{port}", "127.0.0.1@evil.example",
                 f"evil.example/127.0.0.1:{port}", "2130706433", "127.1", "[::ffff:127.0.0.1]",
                 "127.0.0.1, evil.example",
                 f"127.0.0.1:{port}\r\nHost: evil.example", f"evil.example\r\nHost: 127.0.0.1:{port}", " ",
                 "a" * 300,
                 "127.0.0.1:99999999", None):  # fmt: skip
        for path in ("/", "/tab/", "/rerun/"):
            yield answered(ask(port, path, host=host), f"Host {host!r}")


def other_sites_requests(target: Target) -> Tries:
    """Cross-site requests: a page of another site reads, or tells, in the name of the person who looks at it."""
    port = target.port
    for origin in EVIL:
        for path in ("/", "/tab/", "/rerun/", "/rerun/events"):
            yield answered(ask(port, path, Origin=origin), f"Origin {origin}")
        body = b'{"type": "tab", "tab": null}'
        for path in ("/tab/event", "/rerun/event"):
            reply = ask(port, path, method="POST", body=body, Origin=origin, Content_Type="text/plain")
            yield answered(reply, f"POST from {origin}")
    for mode in ("no-cors", "cors", "websocket"):
        reply = ask(port, "/", Sec_Fetch_Site="cross-site", Sec_Fetch_Mode=mode)
        yield answered(reply, f"cross-site {mode}")


def other_sites_websockets(target: Target) -> Tries:
    """Cross-site WebSockets, which browsers open without asking the server of the other site."""
    for origin in EVIL:
        refused = socket_refused(target.port, origin=origin)
        yield None if refused else f"a WebSocket from {origin} was opened"
    refused = socket_refused(target.port, additional_headers={"Sec-Fetch-Site": "cross-site"})
    yield None if refused else "a cross-site WebSocket was opened"
    yield None if socket_refused(target.port, protocol="viser-v0.0.0") else "another version was let in"


def visers_own_port(target: Target) -> Tries:
    """Viser's private port, behind the front door, is found by somebody who tries all ports."""
    for bench in (target.bench, target.closed):
        port, before = bench.server.get_port(), len(bench.server.get_clients())
        for key in (None, "", "x" * 43, "é"):
            head = {} if key is None else {"Simaps-Key": key}
            try:
                with open_socket(port, additional_headers=head) as mine:
                    say(mine, **CAMERA)
                    yield None if hung_up(mine) else "a page was let in without the front door"
            except (InvalidHandshake, OSError, UnicodeError):
                yield None
            yield None if len(bench.server.get_clients()) <= before else "viser believes in a page"


def ways_out_of_the_folder(target: Target) -> Tries:
    """Path traversal in all spellings, to a file beside the recording, to a link to it, and to the system's."""
    secret, link = target.secret.name, target.secret.with_name("link.rrd").name
    for step in ("..", "%2e%2e", "%2E.", "%252e%252e", "..%00", "....", "..;", "%c0%ae%c0%ae", "%uff0e%uff0e", ".%0d."):
        for slash in ("/", "%2f", "%252f", "\\", "%5c", "%255c", "//", "/./", "%c0%af"):
            for prefix in ("/", "/recordings/", "/rerun/", "/tab/"):
                for goal in (secret, link, "etc/passwd", str(target.secret).lstrip("/")):
                    path = prefix + (step + slash) * (1 if goal in (secret, link) else 8) + goal
                    yield leaked(target, ask(target.port, path), path)
    for path in (str(target.secret), f"/recordings/{secret}", f"/recordings/{link}", f"file://{target.secret}",
                 f"//{target.secret}", "/recordings/", "/recordings", f"/recordings/{quote(str(target.secret), '')}",
                 f"http://evil.example{target.secret}", "/recordings/%00", "/~root/", "/.git/config"):  # fmt: skip
        yield leaked(target, ask(target.port, path), path)


def leaked(target: Target, reply: Reply, path: str) -> str | None:
    """Return whether an answer holds what nobody may read."""
    found = target.secret_text in reply.text or "root:" in reply.text
    return f"{path} gave it away" if found else None


def without_the_token(target: Target) -> Tries:
    """A server that demands a token is asked without it, with a part of it, in another case, in other places."""
    access, port = target.closed.access, target.closed.port
    token = access.token
    tokens = [token[:length] for length in range(len(token))]
    tokens += [token + "x", token.swapcase(), " " + token, token[::-1], "*", "null", "%00" + token, token + "%00"]
    for path in ("/", "/tab/", "/rerun/", "/rerun/events", "/recordings/toy.rrd"):
        yield answered(ask(port, path), f"{path} without a token")
        yield answered(ask(port, path, Authorization=f"Bearer {token}"), "a token in another place")
        yield answered(ask(port, path, Cookie=f"simaps={token}"), "a token under another name")
    for given in tokens:
        target.closed.access.forgive()  # so that each is judged, and not only turned away for being one too many
        yield answered(ask(port, f"/?token={given}"), f"token {given!r}")
        target.closed.access.forgive()
        yield answered(ask(port, "/", Cookie=f"{access.cookie}={given}"), f"cookie {given!r}")
    yield answered(ask(port, "/tab/event", method="POST", body=b"{}"), "POST without a token")
    target.closed.access.forgive()
    yield None if socket_refused(port) else "a WebSocket without a token was opened"
    yield None if socket_refused(port, path=f"/?token={token[:-1]}") else "a WebSocket with a part of it was opened"
    target.closed.access.forgive()


def guessing_the_token(target: Target) -> Tries:
    """Many tokens are tried; soon none is looked at any more, and who is in stays in."""
    access, port = target.closed.access, target.closed.port
    inside = enter(target.closed)
    statuses = [ask(port, f"/?token=guess{n}").status for n in range(60)]
    yield None if statuses.count(401) <= 12 else f"{statuses.count(401)} guesses were looked at"
    yield None if statuses[-1] == 429 else "guessing is never slowed down"
    yield answered(ask(port, f"/?token={access.token}"), "the right token among the guesses")
    yield None if ask(port, "/", Cookie=inside).status == 200 else "somebody's guesses threw others out"
    access.forgive()


def locking_out_by_others_pages(target: Target) -> Tries:
    """Another site's page opens the workbench with wrong tokens in hidden frames, so that its reader cannot come in."""
    access = target.closed.access
    port = target.closed.port
    for n in range(30):
        for path, cookie in ((f"/?token=x{n}", "a=b"), ("/", f"{access.cookie}=x{n}")):
            reply = ask(port, path, Cookie=cookie, Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate")
            yield answered(reply, "a wrong token")
    status = ask(port, f"/?token={access.token}").status
    yield None if status == 200 else f"who has the right token is answered {status}"
    access.forgive()


def token_in_answers(target: Target) -> Tries:
    """The token is looked for in what the servers answer, and in the cookie that servers on other ports get as well."""
    access, inside = target.closed.access, enter(target.closed)
    port = target.closed.port
    for path in ("/", "/tab/", "/rerun/", f"/?token={access.token[:-1]}"):
        yield "it came back" if access.token in ask(port, path, Cookie=inside).text else None
        as_token = inside.partition("=")[2]
        yield answered(ask(port, f"{path.partition('?')[0]}?token={as_token}"), "the cookie in the token's place")
    yield answered(ask(port, "/", Cookie=f"{access.cookie}={access.token}"), "the token in the cookie's place")
    access.forgive()
    reply = ask(target.closed.port, f"/?token={access.token}")
    yield "it came back" if access.token in reply.text else None
    line = next((line for line in reply.head.splitlines() if line.startswith("Set-Cookie")), "")
    yield (
        None if all(word in line for word in ("HttpOnly", "SameSite=Strict")) else f"a cookie that scripts read: {line}"
    )
    access.forgive()


def lines_in_names(target: Target) -> Tries:
    """Header injection: line ends in paths, names and queries, to smuggle headers into answers."""
    port = target.port
    for end in ("%0d%0a", "%0a", "%0d", "\r\n", "%E5%98%8A%E5%98%8D", "%00"):
        for path in (f"/{end}X-Evil:1", f"/recordings/a{end}X-Evil:1", f"/?session=a{end}X-Evil:1",
                     f"/rerun/?token=a{end}X-Evil:1", f"/tab/{end}{end}<script>"):  # fmt: skip
            reply = ask(port, path)
            yield "a header was smuggled in" if "\nX-Evil" in reply.head else None
            yield "a script was echoed" if b"<script>" in reply.body and reply.status != 200 else None


def requests_that_are_none(target: Target) -> Tries:
    """Broken, enormous and ambiguous requests: each is refused, and nothing of it is echoed."""
    port = target.port
    host = f"Host: 127.0.0.1:{port}\r\n"
    post = f"POST /tab/event HTTP/1.1\r\n{host}"
    for request in (
        "GET / HTTP/9.9\r\n\r\n", "GET\r\n\r\n", "\r\n\r\n", "\x00" * 100, "\xff\xfe" * 500, "GET / HTTP/1.1",
        f"GET /{'a' * 70_000} HTTP/1.1\r\n{host}\r\n", f"GET /{'a' * 3000} HTTP/1.1\r\n{host}\r\n",
        f"GET / HTTP/1.1\r\n{host}X: {'a' * 100_000}\r\n\r\n",
        f"GET / HTTP/1.1\r\n{host}" + "".join(f"X{n}: 1\r\n" for n in range(300)) + "\r\n",
        f"TRACE /<script>evil HTTP/1.1\r\n{host}X: <script>evil\r\n\r\n", f"<script>evil / HTTP/1.1\r\n{host}\r\n",
        f"CONNECT evil.example:443 HTTP/1.1\r\n{host}\r\n", f"OPTIONS * HTTP/1.1\r\n{host}\r\n",
        f"{post}Content-Length: 10000000000\r\n\r\n", f"{post}Content-Length: -1\r\n\r\n", f"{post}\r\n",
        f"{post}Content-Length: 9\r\nContent-Length: 2\r\n\r\n{{}}", f"{post}Content-Length: ٣\r\n\r\n{{}}",
        f"{post}Transfer-Encoding: chunked\r\n\r\nFFFFFFFFFF\r\n",
        f"{post}Content-Length: 200000\r\n\r\n{'a' * 200_000}",
        f"PUT / HTTP/1.1\r\n{host}\r\n", f"DELETE /recordings/toy.rrd HTTP/1.1\r\n{host}\r\n",
        "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    ):  # fmt: skip
        reply = send_raw(port, request.encode("utf-8"), finish=True)
        yield answered(reply, repr(request[:40])) or ("it was echoed" if "<script>evil" in reply.text else None)
    for range_ in (
        "bytes=0-99999999999999",
        "bytes=-99999999999999",
        "bytes=5-2",
        "bytes=a-b",
        "bytes=" + "0-1," * 500,
    ):
        reply = ask(port, "/recordings/toy.rrd", Range=range_)
        yield f"Range {range_[:20]} failed" if reply.status in (0, 500) else None


def requests_within_requests(target: Target) -> Tries:
    """Request smuggling: what one program takes for the body of a request, or for part of a header, and another not."""
    port = target.port
    host = f"Host: 127.0.0.1:{port}\r\n"
    for path in PAGES:
        yield from _within(port, path, host)


def _within(port: int, path: str, host: str) -> Tries:
    inner = f"GET {path}?smuggled HTTP/1.1\r\n{host}\r\n"
    length = f"Content-Length: {len(inner)}\r\n"
    for method in ("GET", "HEAD", "OPTIONS"):
        for head in (
            length, f"{length}Transfer-Encoding: chunked\r\n", "Transfer-Encoding: chunked\r\n",
            "Transfer-Encoding: \r\n", "Transfer-Encoding: identity\r\n", f"{length}Content-Length: 0\r\n",
            f"Content-Length: 0\r\n{length}", "Content-Length: 0, 0\r\n", "Content-Length: +0\r\n",
            "Content-Length:\r\n", "Content-Length: 0x0\r\n", f"Content-Length : {len(inner)}\r\n",
        ):  # fmt: skip
            yield _answers(port, f"{method} {path} HTTP/1.1\r\n{host}{head}\r\n{inner}")
    for odd in (
        "Origin : http://evil.example\r\n", " Origin: http://evil.example\r\n", "\tX: 1\r\n",
        "X: 1\r\n folded\r\n", "X: 1\r\n\tOrigin: http://evil.example\r\n", "X\r\n", ": 1\r\n", "X(: 1\r\n",
        "X: 1\rOrigin: http://evil.example\r\n", "X: 1\nOrigin: http://evil.example\r\n", "X: \x00\r\n",
        "X: 1\n\r\n", "X\x0b: 1\r\n", "Transfer-Encoding : chunked\r\n", "X: 1\x0c\r\n",
    ):  # fmt: skip
        yield _answers(port, f"GET {path} HTTP/1.1\r\n{host}{odd}\r\n{inner}")
        yield _answers(port, f"GET {path} HTTP/1.1\r\n{odd}{host}\r\n{inner}")
    for line in (f"GET {path} HTTP/1.1\n", f"GET  {path} HTTP/1.1\r\n", f"GET\t{path}\tHTTP/1.1\r\n",
                 f"GET {path} HTTP/1.1 \r\n", f" GET {path} HTTP/1.1\r\n", f"GET {path}\r\n",
                 f"GET {path} HTTP/01.1\r\n", f"GET {path}\x00 HTTP/1.1\r\n", f"get {path} HTTP/1.1\r\n",
                 f"GET {path}\x85HTTP/1.1\r\n"):  # fmt: skip
        yield _answers(port, f"{line}{host}\r\n{inner}")


def _answers(port: int, request: str) -> str | None:
    """Report a request that was answered, or after which another one was read."""
    reply = send_raw(port, request.encode("latin-1"), finish=True)
    if reply.body.count(b"HTTP/1.1 ") or 200 <= reply.status < 300:
        return f"{request[:-50]!r:.90} was answered"
    return None if reply.status or not reply.text else f"{request!r:.90} was answered without a head"


def strange_events(target: Target) -> Tries:
    """What a frame tells in JSON is of wrong types, deep, or of nobody's session."""
    port = target.port
    with page(target.bench) as (_, session):
        for path in ("/tab/event", "/rerun/event"):
            for name in (session.token, "nobody", "", "%00", "a" * 1000):
                bodies = ("null", "[]", "1", '"a"', "{}", "[" * 20_000, '{"type": []}', '{"type": "tab", "tab": {}}',
                          '{"type": "tab", "tab": ["a"]}', '{"type": "tab", "tab": 1e999}',
                          '{"type": "time_update", "time": 1e400}',
                          '{"type": "time_update", "time": NaN}', '{"type": "time_update", "time": -Infinity}',
                          '{"type": "selection_change", "items": [{}, 1, {"type": 5, "position": ["a"]}]}',
                          '{"type": "selection_change", "items": [{"type": "entity", '
                          '"entity_path": "/world/camera/color", "position": [1e308, -1e308, null]}]}')  # fmt: skip
                for body in bodies if name == session.token else bodies[:5]:
                    reply = ask(port, f"{path}?session={name}", method="POST", body=body.encode())
                    yield f"{body[:30]} ended in {reply.status}" if reply.status not in (200, 400, 414) else None
        yield None if session.wait_idle(600.0) else "the page no longer works"
