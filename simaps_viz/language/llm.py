"""Spoken English, or any other language, to a robot program by a language model on any chat-completions server.

What the model writes is only ever data: it goes through ``parse_program`` and a check of its names, like a program
somebody typed, and what does not pass is sent back once and then refused.
"""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from simaps_viz.errors import CommandError
from simaps_viz.language.commands import MAX_LENGTH, Reading, examples, too_long
from simaps_viz.language.llm_chat import Chat
from simaps_viz.language.llm_prompt import (
    SCHEMA,
    command_messages,
    read_answer,
    repair_messages,
)
from simaps_viz.language.llm_settings import (
    Exchange,
    LLMCancelledError,
    LLMError,
    LLMRefusedError,
    LLMServerError,
    LLMSettings,
    Message,
    one_line,
    parse_llm_spec,
)
from simaps_viz.language.primitives import SELF
from simaps_viz.language.program import Program, ProgramError, parse_program
from simaps_viz.language.words import Vocabulary

__all__ = [
    "Exchange",
    "LLMCancelledError",
    "LLMError",
    "LLMReader",
    "LLMReading",
    "LLMRefusedError",
    "LLMServerError",
    "LLMSettings",
    "Message",
    "check_names",
    "parse_llm_spec",
]

REPAIRS: Final = 1
"""How often a model may correct a program that was refused."""

Check = Callable[[str], object]
"""(program) -> raises CommandError when the map cannot take it; nothing may move."""


@dataclass(frozen=True)
class LLMReading(Reading):
    """What a model understood a command to mean."""

    exchanges: tuple[Exchange, ...] = ()
    """What was sent and received."""


class LLMReader:
    """Reads commands with a language model. May be used from several threads.

    Args:
        settings: which model, and where.

    Raises:
        InputError: when the server wants a key and the environment has none.
    """

    def __init__(self, settings: LLMSettings) -> None:
        settings.key()
        self.settings = settings
        self._chat = Chat(settings)

    def read(
        self,
        text: str,
        counts: Mapping[str, int],
        *,
        check: Check | None = None,
        cancel: threading.Event | None = None,
    ) -> LLMReading:
        """Have a command read.

        Args:
            text: the command, in any language.
            counts: {class: number of instances} of the map.
            check: refuses what the map cannot take, on top of unknown names; its words go back to the model.
            cancel: set it to have the wait end at once.

        Raises:
            LLMServerError: no answer could be had.
            LLMRefusedError: the model refuses, or its program was refused twice; with the last reason.
            LLMCancelledError: cancelled.
            CommandError: an empty or overlong command.
        """
        if len(text) > MAX_LENGTH:
            raise CommandError(too_long(text))
        if not text.strip():
            raise CommandError(f"nothing to do was said. {examples(tuple(counts))}")
        record: list[Exchange] = []
        try:
            program, repairs = self._program(text.strip(), counts, check, record, cancel)
        except LLMError as error:
            error.exchanges = tuple(record)
            raise
        note = f"by {self.settings.model}" + (f", {repairs} repair" if repairs else "")
        return LLMReading(program, (note,), exchanges=tuple(record))

    def _program(
        self,
        text: str,
        counts: Mapping[str, int],
        check: Check | None,
        record: list[Exchange],
        cancel: threading.Event | None,
    ) -> tuple[str, int]:
        """Return a valid program, and how many repairs it took."""
        more: list[Message] = []
        reason = ""

        def compose(structured: bool) -> list[Message]:
            return [*command_messages(text, counts, structured=structured), *more]

        for repairs in range(REPAIRS + 1):
            answer = self._chat.ask(compose, SCHEMA, record.append, cancel)
            try:
                program, refusal = read_answer(answer)
                if refusal:
                    raise LLMRefusedError(f"{self.settings.model} refuses: {one_line(refusal, 300)}")
                check_names(parse_program(program), counts)
                if check is not None:
                    check(program)
            except LLMRefusedError:
                raise
            except CommandError as error:
                reason = str(error)
                more.extend(repair_messages(answer, reason))
            else:
                return program, repairs
        raise LLMRefusedError(
            f"{self.settings.model} wrote no program that can be carried out, in {REPAIRS + 1} tries: {reason}"
        )


def check_names(program: Program, counts: Mapping[str, int]) -> None:
    """Refuse every class written in a program that a map has not.

    Raises:
        CommandError: naming line, primitive, the class, and all the map has.
    """
    vocabulary = Vocabulary(counts)
    for call in program.calls:
        for parameter in call.primitive.parameters:
            value = call.constant(parameter.name)
            asks_itself = call.primitive.name == "get_pos" and value == SELF
            named = parameter.type in ("label", "object") and isinstance(value, str) and not asks_itself
            if named and not vocabulary.resolve(str(value)):
                has = ", ".join(f"{label} ({n})" for label, n in counts.items()) or "no objects at all"
                message = f"There is no {value} on this map. It has: {has}."
                raise ProgramError(call.line, call.primitive.name, message)
