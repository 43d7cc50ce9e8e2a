"""Compiles the kernels of building, asking and planning, which numba keeps beside the code, before many need them."""

import contextlib
import io
import tempfile
from pathlib import Path

from sequences import write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.cli.main import main
from simaps_viz.live.run import warm_up

with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
    sequence = write_tiny_sequence(Path(folder) / "tiny")
    warm_up(BuildConfig())
    main(["build", str(sequence), "-o", f"{folder}/map.npz", "--method", "paper"])
    main(["query", f"{folder}/map.npz", "go to the chair"])
