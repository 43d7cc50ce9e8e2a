"""Where the command begins; so small that Ctrl-C is answered in one line from the first moment on."""

import sys


def main() -> int:
    """Run the command line; see `cli.run` for the exit status."""
    try:
        from simaps_viz.cli.main import main as run  # noqa: PLC0415 - takes a second

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("simaps: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
