"""The docked recording of a build that goes on rests between its pictures, for the build needs the processors."""

import pytest
from browser import watched_page

from simaps_viz.recorder.web_viewer import rerun_page

DRAWS_MS = 60
# A clock that only drawing and waiting move, so that what lasts how long does not depend on the machine.
CLOCK = """() => {
  let now = performance.now();
  window.performance.now = () => now;
  window.setTimeout = (call, ms) => drawSoon(() => drawSoon(() => { now += ms; call(); }));
  window.lasts = (n, ms) => new Promise((done) => {
    const began = now;
    const draw = () => {
      now += ms;
      if (--n) window.requestAnimationFrame(draw);
      else done(now - began);
    };
    window.requestAnimationFrame(draw);
  });
}"""
LASTS = "([n, ms]) => window.lasts(n, ms)"


@pytest.fixture
def page(browser):
    with watched_page(browser) as page:
        page.set_default_timeout(60_000)
        yield page


def show(page, recording):
    """The page as it is, but for rerun itself: who draws here is the test."""
    page.set_content(rerun_page([recording]))
    page.wait_for_function("() => window.simapsReady === false")  # the script's end


def test_a_stream_is_drawn_with_rests_unless_somebody_is_at_it(page):
    show(page, "rerun+http://127.0.0.1:1/proxy")
    page.evaluate(CLOCK)
    rest = page.evaluate("() => RESTS") * DRAWS_MS
    assert page.evaluate(LASTS, [4, DRAWS_MS]) == pytest.approx(4 * DRAWS_MS)  # it is being opened
    page.evaluate("() => { ids.set('the stream', 'is open'); atItAt = -1e9; }")
    watched = page.evaluate(LASTS, [4, DRAWS_MS])
    assert 4 * DRAWS_MS + 2 * rest <= watched <= 4 * (DRAWS_MS + rest)
    for one in ("pointermove", "wheel", "keydown"):
        page.evaluate("() => { atItAt = -1e9; }")
        page.evaluate("(one) => window.dispatchEvent(new Event(one))", one)
        assert page.evaluate(LASTS, [4, DRAWS_MS]) == pytest.approx(4 * DRAWS_MS)


def test_what_is_asked_for_while_it_rests_can_be_taken_back(page):
    show(page, "rerun+http://127.0.0.1:1/proxy")
    page.evaluate("""() => {
      ids.set('the stream', 'is open');
      atItAt = -1e9;
      drawingMs = 100;
      drawnAt = performance.now();
    }""")
    drawn = page.evaluate("""async () => {
      const drawn = [];
      const one = window.requestAnimationFrame(() => drawn.push("taken back"));
      await new Promise((done) => {
        window.requestAnimationFrame(() => done(drawn.push("drawn")));
        window.cancelAnimationFrame(one);
      });
      return [...drawn, resting.size];
    }""")
    assert drawn == ["drawn", 0]


def test_a_recording_is_drawn_as_ever(page):
    show(page, "http://127.0.0.1:1/recordings/cafe.rrd")
    assert page.evaluate("() => window.requestAnimationFrame === drawCalmly") is False


TELL = "(event) => onViewerEvent(JSON.stringify(event))"
POSTED = "() => window.posted.map((one) => [one.type, one.time, one.following])"


def told_to(page):
    """Let the test be rerun, and the workbench: what rerun is sent, and what the workbench is told."""
    page.evaluate("""() => {
      window.sent = [];
      window.posted = [];
      viewer = { viewer_control: async (bytes) => window.sent.push(bytes.length) };
      window.fetch = async (_, { body }) => window.posted.push(JSON.parse(body));
      onViewerEvent(JSON.stringify({ type: "timeline_change", timeline: "frame", time: 0 }));
      window.posted.length = 0;
    }""")


def tells(page, time):
    page.evaluate(TELL, {"type": "time_update", "time": time})


def test_a_stream_is_sent_again_to_what_it_does_not_hold_yet_and_tells_nothing_meanwhile(page):
    show(page, "rerun+http://127.0.0.1:1/proxy")
    told_to(page)
    page.evaluate("() => setTime({ timeline: 'frame', play: 'following' })")
    tells(page, 20)
    page.evaluate("() => setTime({ timeline: 'frame', time: 39 })")
    tells(page, 29)  # it holds no more
    page.wait_for_function("() => window.sent.length > 3")
    tells(page, 39)
    page.wait_for_function("() => wanted === null")
    sent = page.evaluate("() => window.sent.length")
    page.wait_for_timeout(1200)
    assert page.evaluate("() => window.sent.length") == sent
    page.evaluate("() => window.dispatchEvent(new Event('pointermove'))")
    tells(page, 12)  # somebody scrubs
    page.wait_for_function("() => window.posted.some((one) => one.time === 12)")
    assert page.evaluate(POSTED) == [["time_update", 20, True], ["time_update", 12, False]]


def test_who_goes_elsewhere_meanwhile_is_not_held(page):
    show(page, "rerun+http://127.0.0.1:1/proxy")
    told_to(page)
    page.evaluate("() => setTime({ timeline: 'frame', time: 39 })")
    page.wait_for_timeout(50)
    page.evaluate("() => window.dispatchEvent(new Event('pointermove'))")
    tells(page, 5)
    page.wait_for_function("() => wanted === null")
    assert page.evaluate(POSTED) == [["time_update", 5, False]]


def test_a_recording_is_sent_once(page):
    show(page, "http://127.0.0.1:1/recordings/cafe.rrd")
    told_to(page)
    page.evaluate("() => setTime({ timeline: 'frame', time: 39 })")
    tells(page, 29)
    page.wait_for_timeout(700)
    assert page.evaluate("() => window.sent.length") == 1
    assert page.evaluate(POSTED) == [["time_update", 29, False]]


def test_an_echo_is_known_however_late_it_comes_and_a_person_who_goes_there_later_is_heard(page):
    show(page, "http://127.0.0.1:1/recordings/cafe.rrd")
    told_to(page)
    later = "() => { const now = performance.now.bind(performance); performance.now = () => now() + 60000; }"
    page.evaluate("() => { viewer.viewer_control = () => new Promise((taken) => { window.taken = taken; }); }")
    page.evaluate("() => { setTime({ timeline: 'frame', time: 39 }); }")
    page.evaluate(later)
    tells(page, 39)  # rerun is slow
    page.evaluate("async () => { window.taken(); await new Promise((done) => setTimeout(done)); }")
    tells(page, 39)
    assert page.evaluate(POSTED) == []
    page.evaluate(later)
    tells(page, 39)
    assert page.evaluate(POSTED) == [["time_update", 39, False]]
