"""What a recorded build tells its page: scrubbing moves it, what comes of following a stream does not."""

from simaps_viz.viewer.recording.link import PageSide, RecordingLink


class Host:
    """Where the recording is served."""

    def __init__(self):
        self.pushed = []

    def push(self, message, session):
        assert session == "mine"
        self.pushed.append(message["set_time"])


def linked(*, building=False):
    host, shown = Host(), [39]
    page = PageSide(
        frame=lambda: shown[-1],
        frames=lambda: 40,
        set_frame=shown.append,
        clicked=lambda items: None,
        building=lambda: building,
    )
    return RecordingLink(host, "mine", page), host, shown  # type: ignore[arg-type]


def update(time, **more):
    return {"type": "time_update", "timeline": "frame", "time": time, **more}


def test_what_a_followed_stream_tells_late_moves_nothing():
    link, host, shown = linked()
    link.opened()
    link.said(update(29, following=True))
    assert shown == [39] and host.pushed == [{"timeline": "frame", "time": 39}]
    link.said(update(12, following=False))
    link.said(update(13))
    assert shown == [39, 12, 13]


def test_while_it_is_built_the_recording_follows_and_moves_nothing():
    link, host, shown = linked(building=True)
    link.said({"type": "timeline_change", "timeline": "frame"})
    link.said(update(12))
    assert shown == [39] and host.pushed == [{"timeline": "frame", "play": "following"}]
