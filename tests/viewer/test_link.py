"""What a recorded build tells its page: scrubbing moves it, what comes of following a stream does not."""

from types import SimpleNamespace

from simaps_viz.viewer.page.recording import RecordingLink


class Host:
    """Where the recording is served."""

    def __init__(self):
        self.pushed = []

    def push(self, message, session):
        assert session == "mine"
        self.pushed.append(message["set_time"])


class LinkedPage:
    """A page of 40 frames."""

    def __init__(self, building):
        self.services = SimpleNamespace(building=building)
        self.simap = SimpleNamespace(frame_names=("name",) * 40)
        self.shown = [39]

    @property
    def frame(self):
        return self.shown[-1]

    def show_frame(self, frame, *, also_recording):
        assert not also_recording
        self.shown.append(frame)


def linked(*, building=False):
    host, page = Host(), LinkedPage(building)
    return RecordingLink(host, "mine", page), host, page.shown  # type: ignore[arg-type]


def update(time, **more):
    return {"type": "time_update", "timeline": "frame", "time": time, **more}


def test_what_a_followed_stream_tells_late_moves_nothing():
    link, host, shown = linked()
    link.opened()
    link.reported(update(29, following=True))
    assert shown == [39] and host.pushed == [{"timeline": "frame", "time": 39}]
    link.reported(update(12, following=False))
    link.reported(update(13))
    assert shown == [39, 12, 13]


def test_a_recording_that_opens_slowly_does_not_take_the_page_to_its_first_frame():
    link, host, shown = linked()
    link.opened()
    link._link._opened_s -= 60.0
    link.reported(update(0, touched=False))
    assert shown == [39] and host.pushed == [{"timeline": "frame", "time": 39}] * 2
    link.reported(update(0, touched=True))
    assert shown == [39, 0]


def test_while_it_is_built_the_recording_follows_and_moves_nothing():
    link, host, shown = linked(building=True)
    link.reported({"type": "timeline_change", "timeline": "frame"})
    link.reported(update(12))
    assert shown == [39] and host.pushed == [{"timeline": "frame", "play": "following"}]
