"""Two workbenches on the toy map to attack, an open one and one with tokens; whatever a page can change is theirs."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from attacks.changes import OWN, build_to_stop
from attacks.target import Target
from browser import free_port, toy_services
from toy_maps import TOY_POSE, toy_map

from simaps_viz.app.workbench import mending_panels
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.mending import open_mending
from simaps_viz.recorder.library import RecordingLibrary
from simaps_viz.viewer.panels.recordings import recordings_panel
from simaps_viz.viewer.server.access import OWNER_VARIABLE, TOKEN_VARIABLE
from simaps_viz.viewer.workbench import Workbench

TOKEN = "A-token_of_0123456789_abcdefghij"


@contextmanager
def toy_target(folder: Path) -> Iterator[Target]:
    recording, secret = folder / "toy.rrd", folder / "secret.txt"
    recording.write_bytes(bytes(range(256)) * 40)
    secret.write_text(Target.secret_text)
    (folder / "link.rrd").symlink_to(secret)
    save_map(toy_map(), folder / "toy.npz")
    library = RecordingLibrary([folder / "library"])
    library.trash.mkdir(parents=True)
    for path in (library.folders[0] / f"{OWN}.rrd", library.trash / "old.rrd"):
        path.write_bytes(recording.read_bytes())
    mending = open_mending(folder / "toy.npz")
    simap = mending.simap()
    services = toy_services(
        rerun_page=lambda urls: "<p>no viewer</p>",
        recordings=(recording,),
        panels=(*mending_panels(mending), recordings_panel(library), build_to_stop(folder)),
    )
    with mock.patch.dict(os.environ, {TOKEN_VARIABLE: TOKEN, OWNER_VARIABLE: f"{TOKEN}-owner"}):
        closed = Workbench(simap, services=services, port=free_port(), start=TOY_POSE)
    with closed, Workbench(simap, services=services, port=free_port(), start=TOY_POSE) as bench:
        assert bench.wait_idle()
        yield Target(bench, closed, secret)
