"""`simaps`: build, view, query and export Semantic Instance Maps."""

import sys
from collections.abc import Sequence
from functools import reduce
from operator import or_
from pkgutil import resolve_name
from typing import Annotated, Any

from simaps_viz import __version__
from simaps_viz.cli import BAD_INPUT, COMMANDS, INTERRUPTED, OK, Command
from simaps_viz.errors import InputError, SIMapsError


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and carry it out; return the exit status, see `run`."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        if words == ["--version"]:
            return _print_version()
        from simaps_viz.console.logs import logged, take_log_options
        from simaps_viz.console.terminal import answering, console

        rest, logging = take_log_options(words)
        with answering():
            command = parse(rest)
        with logged(logging, console):
            return run(command)
    except InputError as error:  # in the log's own options, or while a page of help is written
        _show_error(str(error))
        return BAD_INPUT
    except BrokenPipeError:  # the program that reads our output has ended, as head does
        return _leave_quietly()


def load(name: str) -> type[Command]:
    """Import the class of a command."""
    return resolve_name(COMMANDS[name])


def parse(words: Sequence[str]) -> Command:
    """Return the command that a command line means, with its options filled in.

    Raises:
        SystemExit: help was asked for and printed, or the words are not understood, which was explained.
    """
    import tyro

    name = words[0].replace("_", "-") if words else ""
    if name in COMMANDS:
        return tyro.cli(load(name), prog=f"simaps {name}", args=words[1:])
    # The list of all commands, shell completion, or a typing error: only these need the options of all commands.
    from simaps_viz.console.logs import HELP

    commands: Any = reduce(or_, (Annotated[load(name), _summarised(name)] for name in COMMANDS))
    about = f"{__doc__} simaps COMMAND --help explains one. {HELP} simaps --version prints the version."
    return tyro.cli(tyro.conf.OmitSubcommandPrefixes[commands], prog="simaps", description=about, args=words)


def _summarised(name: str) -> object:
    """Return how a command is listed among all: by the first paragraph of its help."""
    import tyro

    return tyro.conf.subcommand(name, description=(load(name).__doc__ or "").partition("\n\n")[0])


def run(command: Command) -> int:
    """Carry out a command; the exit status is 0 done, 1 the answer is no, 2 bad input or usage, 130 interrupted."""
    from simaps_viz.console.logs import logged_command

    with logged_command(type(command).__name__.lower(), command) as log:
        log.status = _run(command)
        return log.status


def _run(command: Command) -> int:
    from simaps_viz.io.limits import check_port

    try:
        check_port(getattr(getattr(command, "serving", command), "port", 0))
        return command.run()
    except SIMapsError as error:
        _log_error(str(error))
        for note in getattr(error, "__notes__", ()):
            _show(note)
        return BAD_INPUT
    except KeyboardInterrupt as stopped:
        _log_error(str(stopped) or "interrupted; nothing was left half-written")
        return INTERRUPTED
    except BrokenPipeError:
        return _leave_quietly()


def _print_version() -> int:
    try:
        sys.stdout.write(f"simaps {__version__}\n")
        sys.stdout.flush()
    except OSError:
        from simaps_viz.console.terminal import answering

        with answering():  # turns it into the error that every answer gives
            raise
    return OK


def _leave_quietly() -> int:
    """Return the exit status for a broken pipe: the program that read our output has ended."""
    from simaps_viz.console.terminal import drop_answers

    drop_answers()
    return BAD_INPUT


def _log_error(message: str) -> None:
    from simaps_viz.console.logs import logger

    logger.error("%s", message, extra={"event": "error", "people": False})
    _show_error(message)


def _show_error(message: str) -> None:
    _show(f"simaps: {message}", style="red")


def _show(text: str, style: str | None = None) -> None:
    from simaps_viz.console.terminal import console

    console.print(text, markup=False, highlight=False, soft_wrap=True, style=style)


if __name__ == "__main__":
    sys.exit(main())
