"""Who may ask: names, origins, tokens; what a page may say, and how much it may upload."""

from importlib import resources
from typing import Any

import msgspec
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st

from simaps_viz.errors import InputError
from simaps_viz.viewer.server import access as access_module
from simaps_viz.viewer.server.access import Access, headers_of, is_loopback, name_of, without_query
from simaps_viz.viewer.server.page_socket import MAX_UPLOAD, Listener, Uploads
from simaps_viz.viewer.server.viser_page import page_policy, script_sources

TOKEN = "A-token_of_0123456789_abcdefghij"
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [3, 3, 3], "fov": 0.5, "near": 0.1, "far": 10.0,
    "image_height": 600, "image_width": 600, "look_at": [0, 0, 0.5], "up_direction": [0, 0, 1],
}  # fmt: skip


def status(access, path="/", *, own="127.0.0.1", peer="10.0.0.9", writes=False, **headers: str):
    pairs = [(name.replace("_", "-"), value) for name, value in {"Host": "127.0.0.1:8080", **headers}.items()]
    refused = access.refuse(headers_of(pairs), path, own_address=own, peer=peer, writes=writes)
    return 200 if refused is None else refused[0].value


def test_this_machine_needs_no_token_and_others_do(monkeypatch):
    monkeypatch.delenv("SIMAPS_TOKEN", raising=False)
    assert [is_loopback(h) for h in ("127.0.0.1", "::1", "localhost", "127.9.9.9")] == [True] * 4
    assert [is_loopback(h) for h in ("0.0.0.0", "::", "192.168.1.2", "example.org", "")] == [False] * 5
    assert Access().token == Access("::1").token == ""
    first, second = Access("0.0.0.0"), Access("0.0.0.0")
    assert len(first.token) >= 40 and first.token != second.token and first.cookie != second.cookie
    monkeypatch.setenv("SIMAPS_TOKEN", TOKEN)
    assert Access("0.0.0.0").token == Access().token == TOKEN
    for bad in ("short", "with space in the middle", "a;b" * 10, "a" * 201):
        with pytest.raises(InputError, match="SIMAPS_TOKEN: expected 16 to 200 letters"):
            Access(token=bad)


def test_names_it_answers_to():
    access = Access(token="")
    for host in ("127.0.0.1:8080", "localhost:9", "LOCALHOST", "[::1]:8080"):
        assert status(access, Host=host) == 200
    for host in ("evil.example", "localhost.evil.example", "127.0.0.1.", "::1", "a b", "", "localhost:80:80"):
        assert status(access, Host=host) == 403
    assert status(access, Host="192.168.1.2:8080", own="192.168.1.2") == 200
    assert status(access, Host="192.168.1.3:8080", own="192.168.1.2") == 403
    assert status(access, Host="192.168.1.2:8080", own="::ffff:192.168.1.2") == 200
    assert name_of("[::1]:80") == "[::1]" and name_of(None) is None


def test_pages_it_believes():
    access = Access(token="")
    assert status(access, Origin="http://127.0.0.1:8080", writes=True) == 200
    for origin in ("http://127.0.0.1:8081", "http://localhost:8080", "null", "http://evil.example", ""):
        assert status(access, Origin=origin) == 403
    assert status(access, Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate") == 200
    assert status(access, Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="no-cors") == 403
    assert status(access, Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate", writes=True) == 403
    twice = headers_of([("Host", "127.0.0.1"), ("host", "evil.example")])
    assert access.refuse(twice, "/", own_address="127.0.0.1", peer="::1") is not None


def test_a_token_is_asked_for_and_guessing_ends():
    now = [0.0]
    access = Access("0.0.0.0", token=TOKEN, clock=lambda: now[0])
    right = {"Cookie": f"a=b; {entered(access)}"}
    assert status(access) == 401
    assert status(access, f"/?token={TOKEN}") == status(access, Cookie=right["Cookie"]) == 200
    assert [status(access, f"/?token={TOKEN[:-1]}") for _ in range(12)] == [401] * 10 + [429] * 2
    assert status(access, f"/?token={TOKEN}") == 429
    assert status(access, Cookie=right["Cookie"]) == 200  # who is in stays in
    assert status(access, f"/?token={TOKEN}", peer="10.0.0.10") == 200  # and others are not to blame
    now[0] = 61.0
    assert status(access, f"/?token={TOKEN}") == 200
    assert access.entering(headers_of(right.items()), f"/?token={TOKEN}") is None


def entered(access):
    """Return the cookie of a new browser that brings the token."""
    given = access.entering({}, f"/?token={access.token}")["Set-Cookie"]
    cookie, rest = given.split("; ", 1)
    assert cookie.startswith(f"{access.cookie}=") and rest == "HttpOnly; SameSite=Strict; Path=/"
    return cookie


def test_pages_of_other_sites_lock_nobody_out():
    for access in (Access("0.0.0.0", token=TOKEN), Access("0.0.0.0", token="")):
        hidden: dict[str, Any] = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "navigate"}
        assert [status(access, f"/?token=x{n}", **hidden) for n in range(12)] == [401] * 10 + [429] * 2
        assert status(access, f"/?token={access.token}") == 200
        assert [status(access, f"/?token=x{n}") for n in range(12)] == [401] * 10 + [429] * 2
        # where no header tells other sites' pages: a token that nobody guesses is let in, one of a person's may be one
        assert status(access, f"/?token={access.token}") == (429 if access.token == TOKEN else 200)
        assert status(access, Cookie=f"{access.cookie}=wrong") == 429


def test_a_wrong_cookie_is_no_guess():
    """Others on this name may set cookies, and those of browsers that were not seen for long are forgotten."""
    access = Access("0.0.0.0", token=TOKEN)
    assert {status(access, Cookie=f"{access.cookie}=x{n}") for n in range(30)} == {401}
    assert status(access, f"/?token={TOKEN}") == 200
    cookie = entered(access)
    assert status(access, Cookie=f"{access.cookie}=wrong; {cookie}; {access.cookie}=x") == 200


def test_the_cookie_is_of_one_browser_and_never_the_token():
    """Servers on other ports of the same name get cookies, too."""
    access, other = Access("0.0.0.0", token=TOKEN), Access("0.0.0.0", token=TOKEN)
    cookies = [entered(access) for _ in range(3)]
    assert len(set(cookies)) == 3 and not any(TOKEN in cookie for cookie in cookies)
    for cookie in cookies:
        value = cookie.partition("=")[2]
        assert len(value) >= 40 and status(access, f"/?token={value}") == 401
        assert status(access, Cookie=cookie) == 200
        assert status(other, Cookie=f"{other.cookie}={value}") == 401
    assert status(access, Cookie=f"{access.cookie}={TOKEN}") == 401
    assert access.entering({}, f"/?token={TOKEN}x") is None and access.entering({}, "/") is None


def test_so_many_browsers_are_let_in_at_once(monkeypatch):
    monkeypatch.setattr(access_module, "MAX_INSIDE", 3)
    access = Access("0.0.0.0", token=TOKEN)
    first, second, third = (entered(access) for _ in range(3))
    assert status(access, Cookie=first) == 200  # seen last
    fourth = entered(access)
    assert [status(access, Cookie=one) for one in (first, second, third, fourth)] == [200, 401, 200, 200]
    assert len(access._inside) == 3


@given(st.text(max_size=60))
def test_no_other_text_is_the_token(text):
    access = Access("0.0.0.0", token=TOKEN)
    if text != TOKEN:
        assert access._bearer(text) is None
    for line in (f"GET /{text}?token={TOKEN} HTTP/1.1", f"GET /?{text}{TOKEN}", f"GET /?{TOKEN}{text} HTTP/1.1"):
        logged = without_query(f'"{line}" 401 -')
        assert TOKEN not in without_query(line) and TOKEN not in logged
        assert logged.endswith('" 401 -') and logged.isprintable()


def test_the_log_tells_refused_from_accepted():
    assert without_query('"GET /tab/?token=a b" 200 - HTTP/1.1" 401 -') == '"GET /tab/?… HTTP/1.1" 401 -'
    assert without_query('"GET /tab/?session=x HTTP/1.1" 200 -') == '"GET /tab/?… HTTP/1.1" 200 -'
    assert without_query('"GET /tab/ HTTP/1.1" 200 -') == '"GET /tab/ HTTP/1.1" 200 -'
    assert without_query("a\x1b[31mb\n?c") == "a.[31mb.?…"


def test_the_scripts_of_visers_page_are_known_one_by_one():
    page = resources.files(viser).joinpath("client/build/index.html").read_bytes()
    sources = script_sources(page)
    assert "unsafe-inline" not in sources and "'unsafe-eval'" not in sources
    assert sources.count("'sha256-") == 3  # what unpacks the page, the page, and our handler
    csp = page_policy("localhost:8080", page)
    assert "default-src 'none'" in csp and "frame-src 'self'" in csp and "ws://localhost:8080 " in csp


def heard(message):
    return Listener(Uploads()).fault(msgspec.msgpack.encode(message))


def test_what_a_page_may_say():
    assert heard(CAMERA) is None
    for value in (True, 3, 0.5, "text", [1, 2], [0.5, 1], ["a"], None):
        assert heard({"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": value}}) is None
    for wrong in ({"removed": True}, {"value": 1, "update_cb": []}, {}, {"value": {"a": 1}}, {"value": float("nan")},
                  {"value": float("inf")}, {"value": 1e300}, {"value": "a" * 100_001}, {"value": b"a"}):  # fmt: skip
        assert heard({"type": "GuiUpdateMessage", "uuid": "a", "updates": wrong}) is not None
    for other in ("RunJavascriptMessage", "ShareUrlRequest", "GuiFormDirtyMessage", "RemoveSceneNodeMessage", "None"):
        assert heard({"type": other, "uuid": "a", "source": "1"}) is not None
    assert heard({**CAMERA, "excluded_self_client": 1}) is not None
    assert heard({**CAMERA, "fov": float("nan")}) is not None


def start(listener, transfer, size, parts=1, component="c"):
    message = {"type": "FileTransferStartUpload", "source_component_uuid": component, "transfer_uuid": transfer}
    message |= {"filename": "a", "mime_type": "b", "part_count": parts, "size_bytes": size}
    return listener.fault(msgspec.msgpack.encode(message))


def part(listener, transfer, content):
    message = {"type": "FileTransferPart", "source_component_uuid": "c", "transfer_uuid": transfer}
    return listener.fault(msgspec.msgpack.encode({**message, "part_index": 0, "content": content}))


def test_uploads_are_bounded_for_a_page_and_for_all():
    uploads = Uploads(most=3 * MAX_UPLOAD // 2)
    one, two = Listener(uploads), Listener(uploads)
    assert start(one, "a", MAX_UPLOAD + 1) is not None
    assert start(one, "a", MAX_UPLOAD) is None
    assert start(one, "b", 1) is not None  # one page's share
    assert start(two, "a", MAX_UPLOAD) is not None  # all pages' share
    one.close()
    assert uploads.taken == 0 and start(one, "c", 1) is not None
    assert start(two, "a", 10, 2) is None
    assert part(two, "a", b"12345678901") is not None
    assert part(two, "a", b"12345") is None and part(two, "a", b"67890") is None
    assert part(two, "a", b"") is not None and part(two, "x", b"") is not None
    assert start(two, "b", 20) is None and uploads.taken == 20  # the file before it is forgotten
