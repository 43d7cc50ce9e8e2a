"""The command line: one file a command, a dataclass whose fields are its options and whose ``run`` carries it out.

A new command is a new file and a line in ``COMMANDS``. Its module is imported when it is named on the command line, so
at its top it imports what its options need; all else is imported where it is used.
"""

from typing import Protocol

OK, NO, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
"""Exit status: done; the answer is no; bad input or usage; interrupted by Ctrl-C."""


class Command(Protocol):
    """Options of a command, as the command line filled them in."""

    def run(self) -> int:
        """Carry out the command and return ``OK`` or ``NO``; bad input raises SIMapsError."""
        ...


COMMANDS = {
    "demo": "simaps_viz.cli.demo:Demo",
    "build": "simaps_viz.cli.build:Build",
    "view": "simaps_viz.cli.view:View",
    "query": "simaps_viz.cli.query:Query",
    "live": "simaps_viz.cli.live:Live",
    "info": "simaps_viz.cli.info:Info",
    "describe": "simaps_viz.cli.describe:Describe",
    "mend": "simaps_viz.cli.mend:Mend",
    "check": "simaps_viz.cli.check:Check",
    "export": "simaps_viz.cli.export:Export",
    "share": "simaps_viz.cli.share:Share",
    "convert": "simaps_viz.cli.convert:Convert",
    "evaluate": "simaps_viz.cli.evaluate:Evaluate",
    "judge": "simaps_viz.cli.judge:Judge",
    "segment": "simaps_viz.cli.segment:Segment",
    "export-network": "simaps_viz.cli.export_network:ExportNetwork",
    "bench-network": "simaps_viz.cli.bench_network:BenchNetwork",
    "recordings": "simaps_viz.cli.recordings:Recordings",
    "doctor": "simaps_viz.cli.doctor:Doctor",
}
"""The commands in the order of the help: name and "module:class"."""
