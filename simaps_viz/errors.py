"""The errors a person can meet; every message names the culprit and what was expected."""


class SIMapsError(Exception):
    """Base of all errors this package raises on purpose; the command line prints it as one line."""


class InputError(SIMapsError):
    """A file, folder, option or argument is not what it has to be."""


class CommandError(SIMapsError):
    """A spoken command or a program cannot be carried out on this map: a refusal, in words."""


class PlanningError(SIMapsError):
    """There is no free path from where the robot stands to where it should go."""
