"""Two workbenches on the toy map to attack, an open one and one with a token, whose recording lies beside a secret."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

from attacks.target import Target
from browser import free_port, toy_services
from toy_maps import TOY_POSE, toy_map

from simaps_viz.viewer.server.access import TOKEN_VARIABLE
from simaps_viz.viewer.workbench import Workbench

TOKEN = "A-token_of_0123456789_abcdefghij"


@contextmanager
def toy_target(folder: Path) -> Iterator[Target]:
    recording, secret = folder / "toy.rrd", folder / "secret.txt"
    recording.write_bytes(bytes(range(256)) * 40)
    secret.write_text(Target.secret_text)
    (folder / "link.rrd").symlink_to(secret)
    services = toy_services(rerun_page=lambda urls: "<p>no viewer</p>", recordings=(recording,))
    with mock.patch.dict(os.environ, {TOKEN_VARIABLE: TOKEN}):
        closed = Workbench(toy_map(), services=services, port=free_port(), start=TOY_POSE)
    with closed, Workbench(toy_map(), services=services, port=free_port(), start=TOY_POSE) as bench:
        assert bench.wait_idle()
        yield Target(bench, closed, secret)
