"""Scripts in names, in Debian's Chromium: in the page, the shared file and the recorded build; other sites' pages."""

import http.server
import threading

import pytest
from attack_target import toy_target
from browser import PATIENCE_S, field_of, free_port, mine, open_workbench, toy_services, until, watched_page
from hostile_maps import IMAGE, PWNED, SCRIPT, hostile_map
from playwright.sync_api import expect

from simaps_viz.errors import CommandError
from simaps_viz.recorder.web_viewer import CONTENT_SECURITY_POLICY, rerun_page, viewer_assets
from simaps_viz.viewer.page.share import page_html
from simaps_viz.viewer.server.front_door import FrontDoor
from simaps_viz.viewer.server.host import Host
from simaps_viz.viewer.workbench import Workbench

MAP_SHOWN = "() => window.__viserMutable?.nodeRefFromName?.['/map'] != null"


def stranger(browser, **how):
    """A page that nobody watches."""
    page = browser.new_context(**how).new_page()
    page.set_default_timeout(1000 * PATIENCE_S)
    return page


def has_come(page, words):
    """Wait until the page shows some words: what came before them is there as well."""
    page.wait_for_function("(words) => document.body.innerText.includes(words)", arg=words)


def refuse(simap, command, pose, robot):
    raise CommandError(f"There is no {command}{IMAGE}{SCRIPT}")


@pytest.fixture(scope="module")
def opened(browser):
    """A page on the hostile map, for both lines of defence in turn."""
    services = toy_services()
    object.__setattr__(services, "ask", refuse)
    with Workbench(hostile_map(), services=services, port=free_port()) as bench, watched_page(browser) as page:
        open_workbench(page, bench)
        yield bench, page


def test_no_name_runs_a_script_on_the_page(opened):
    bench, page = opened
    session, simap = mine(bench), bench.simap
    for instance in simap.instances:
        session.select(instance.id)
        session.wait_idle()
        x, y, _ = instance.centroid_m
        has_come(page, f"x {x:.2f} m, y {y:.2f} m (map frame)")
        page.wait_for_timeout(150)
        assert not page.evaluate(PWNED)
    session.say(IMAGE, SCRIPT)
    session.report(CommandError(IMAGE + SCRIPT))
    session.report(ValueError(IMAGE + SCRIPT))
    has_come(page, f"{IMAGE}\n{SCRIPT}\n")
    has_come(page, f"Unexpected error (ValueError)\n{IMAGE}{SCRIPT}")
    page.get_by_role("tab", name="Build").click()
    has_come(page, f"is picture {simap.frame_names[-1]} of the sequence")
    page.wait_for_timeout(200)
    assert not page.evaluate(PWNED)
    page.get_by_role("tab", name="Command").click()
    field_of(page, "Command").wait_for()
    page.wait_for_timeout(200)
    assert not page.evaluate(PWNED)
    field_of(page, "Command").fill(IMAGE + SCRIPT + "\n")
    has_come(page, "There is no")
    page.wait_for_timeout(300)
    assert not page.evaluate(PWNED)
    assert bench.door.refused.total() == 0  # nothing an honest page said was dropped


def test_even_html_that_got_in_runs_nothing(opened):
    """The second line of defence: what a panel forgot to escape."""
    bench, page = opened
    mine(bench).gui.add_html(f'{IMAGE}{SCRIPT}<a id="go" href="javascript:window.pwned=1">go</a>')
    mine(bench).gui.add_markdown(f"{IMAGE} [go](javascript:window.pwned=1) {{window.pwned=1}}")
    page.wait_for_selector("#go", state="attached")
    page.evaluate("() => document.querySelector('#go').click()")
    page.wait_for_timeout(500)
    assert page.evaluate("() => window.pwned") is None
    for code in ("eval('1')", "new Function('return 1')()"):
        later = f"setTimeout(() => {{ try {{ {code}; tell('ran'); }} catch {{ tell('refused'); }} }})"
        assert page.evaluate(f"() => new Promise((tell) => {later})") == "refused"
    away = "fetch('http://127.0.0.1:1/?secret').then(() => 'sent', () => 'refused')"
    blocked = page.evaluate(
        f"() => new Promise((tell) => {{ document.addEventListener('securitypolicyviolation', (e) => "
        f"tell(e.effectiveDirective)); {away}; }})"
    )
    assert blocked == "connect-src"


def test_no_name_runs_a_script_in_a_shared_file(browser, tmp_path):
    path = tmp_path / "shared.html"
    path.write_bytes(page_html(hostile_map()))
    page = stranger(browser, offline=True)
    page.goto(path.as_uri())
    page.wait_for_function(MAP_SHOWN)
    has_come(page, IMAGE + SCRIPT)
    page.wait_for_timeout(2000)
    assert not page.evaluate(PWNED)
    page.context.close()


def test_no_name_runs_a_script_beside_the_recorded_build(browser):
    def page_of(urls):
        return rerun_page([f"/recordings/{SCRIPT}{IMAGE}.rrd"], note=IMAGE + SCRIPT)

    host = FrontDoor().start([Host(page=page_of, assets=viewer_assets(), csp=CONTENT_SECURITY_POLICY)])
    page = stranger(browser)
    page.goto(host.url)
    page.wait_for_function("() => window.simapsReady")
    assert page.locator("#note").inner_text() == IMAGE + SCRIPT
    page.wait_for_timeout(500)
    assert not page.evaluate(PWNED)
    page.context.close()
    host.close()


OTHER_SITE = """<!doctype html><script>
window.found = {};
const port = location.hash.slice(1), at = "127.0.0.1:" + port;
const socket = new WebSocket("ws://" + at, ["viser-v1.1.1"]);
socket.onopen = () => { found.socket = true; };
socket.onerror = () => { found.socket ??= false; };
fetch("http://" + at).then((answer) => answer.text()).then(() => { found.read = true; }, () => { found.read = false; });
fetch("http://" + at, { mode: "no-cors" }).then((answer) => { found.opaque = answer.status; }, () => {});
const frame = document.createElement("iframe"); frame.src = "http://" + at; document.documentElement.append(frame);
frame.onload = () => { try { found.frame = frame.contentDocument !== null; } catch { found.frame = false; } };
</script>"""


def test_another_sites_page_gets_nothing(browser):
    """A page served on another port, and one by another name for this machine, as a rebinding attacker has it."""

    class Other(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            body = OTHER_SITE.encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            pass

    other = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Other)
    threading.Thread(target=other.serve_forever, daemon=True).start()
    with Workbench(hostile_map(), services=toy_services(), port=free_port()) as bench:
        port = bench.port
        for name in ("127.0.0.1", "localhost"):
            page = stranger(browser)
            page.goto(f"http://{name}:{other.server_port}/#{port}")
            until(page, lambda page=page: {"socket", "read", "frame"} <= set(page.evaluate("() => window.found")))
            page.wait_for_timeout(500)
            found = page.evaluate("() => window.found")
            assert not found.get("socket") and not found.get("read") and not found.get("frame"), found
            page.context.close()
        assert len(bench.sessions) == 0
    other.shutdown()
    other.server_close()


def test_a_visitors_page_changes_nothing_until_the_owners_address_is_opened(browser, tmp_path):
    with toy_target(tmp_path) as target, watched_page(browser) as page:
        answer = page.goto(target.closed.url)  # without the token
        assert answer is not None and answer.status == 401
        for address, owner in ((target.closed.entrance, False), (target.closed.owner_entrance, True)):
            page.goto(address)
            page.wait_for_function(MAP_SHOWN)
            page.get_by_role("tab", name="Build", exact=True).click()
            page.get_by_text("Recorded builds", exact=True).click()
            page.get_by_role("button", name="List again").wait_for()
            assert "token" not in page.url
            seen = page.evaluate("() => document.cookie + document.documentElement.outerHTML")
            assert target.closed.access.token not in seen
            until(page, lambda: target.closed.tabs._session_of)  # its hidden frame came in, with the cookie
            expect(page.get_by_role("tab", name="Mend", exact=True)).to_have_count(int(owner))
            for name in ("Rename …", "Delete …", "Restore …"):
                expect(page.get_by_role("button", name=name, exact=True)).to_have_count(int(owner))
            page.get_by_role("button", name="Help", exact=True).click()
            page.get_by_text("How to use this page").wait_for()
            expect(page.get_by_text("You are visiting")).to_have_count(int(not owner))
            page.keyboard.press("Escape")


def test_a_tab_that_nobody_looks_at_holds_no_connection(browser):
    """Else the seventh tab with a recorded build would wait for ever: browsers open six connections to a host."""
    host = Host(page=lambda urls: rerun_page([]), assets=viewer_assets(), csp=CONTENT_SECURITY_POLICY)
    door = FrontDoor().start([host])
    heard = []
    host.on_listen = heard.append
    page = stranger(browser)
    page.goto(f"{door.url}?session=one")
    page.wait_for_function("() => window.simapsReady")
    until(page, lambda: heard == ["one"])
    look = "(state) => { Object.defineProperty(document, 'visibilityState', { value: state, configurable: true }); "
    look += "document.dispatchEvent(new Event('visibilitychange')); }"
    page.evaluate(look, "hidden")
    until(page, lambda: not host._listeners)
    page.evaluate(look, "visible")
    until(page, lambda: heard == ["one", "one"] and len(host._listeners) == 1)
    page.context.close()
    door.close()
