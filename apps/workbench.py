"""Open the workbench on a map or on a sequence, which is mapped first: `python apps/workbench.py MAP|SEQUENCE`."""

import sys

import tyro

from simaps_viz.cli.main import run
from simaps_viz.cli.view import View

if __name__ == "__main__":
    sys.exit(run(tyro.cli(View)))
