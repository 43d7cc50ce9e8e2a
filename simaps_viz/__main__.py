"""Entry point; it imports nothing at its top, so that Ctrl-C is answered in one line from the start."""

import sys


def main() -> int:
    """Run the command line and return the exit status; see `cli.main.run`."""
    try:
        from simaps_viz.cli.main import main as run  # noqa: PLC0415 - an interrupt meanwhile is answered, too

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("simaps: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
