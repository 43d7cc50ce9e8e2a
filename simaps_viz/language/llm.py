"""Spoken English, or any other language, to a robot program by a language model on any chat-completions server.

The model's answer is treated as data: like a program that a person typed, it is parsed by ``parse_program`` and its
names are checked. An answer that fails is returned to the model once with the error, and then refused.

The prompt is ``prompt.md``, with the tables of ``primitives``; its examples are in ``prompt_examples.json``. What never
changes comes first, so that servers can cache it.
"""

import json
import re
import textwrap
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from simaps_viz.errors import CommandError
from simaps_viz.language.commands import MAX_LENGTH, Reading, examples, too_long
from simaps_viz.language.llm_chat import Chat
from simaps_viz.language.llm_settings import (
    Exchange,
    LLMError,
    LLMRefusedError,
    LLMSettings,
    Message,
    one_line,
)
from simaps_viz.language.primitives import ARGUMENT_KINDS, FUNCTIONS, PRIMITIVES, SELF
from simaps_viz.language.program import MAX_TEXT, Program, ProgramError, parse_program
from simaps_viz.language.words import Vocabulary, load, load_text

REPAIRS: Final = 1
"""How often a model may correct a program that was refused."""

Check = Callable[[str], object]
"""(program) -> raises CommandError when the map cannot take it; nothing may move."""


@dataclass(frozen=True)
class LLMReading(Reading):
    """A model's interpretation of a command."""

    exchanges: tuple[Exchange, ...] = ()
    """The requests and responses."""


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
        rooms: Sequence[str] = (),
        check: Check | None = None,
        cancel: threading.Event | None = None,
    ) -> LLMReading:
        """Ask the model to turn a command into a program.

        Args:
            text: the command, in any language.
            counts: {class: number of instances} of the map.
            rooms: names of the map's rooms.
            check: raises CommandError for a program that the map does not permit, in addition to the check of names;
                its message is returned to the model.
            cancel: setting it ends the wait at once.

        Raises:
            LLMServerError: the server did not answer.
            LLMRefusedError: the model refuses, or its program was refused twice; with the last reason.
            LLMCancelledError: cancelled.
            CommandError: an empty or overlong command.
        """
        if len(text) > MAX_LENGTH:
            raise CommandError(too_long(text))
        if not text.strip():
            raise CommandError("nothing to do was said", suggestions=examples(counts))
        record: list[Exchange] = []
        try:
            program, repairs = self._program(text.strip(), counts, rooms, check, record, cancel)
        except LLMError as error:
            error.exchanges = tuple(record)
            raise
        note = f"by {self.settings.model}" + (f", {repairs} repair" if repairs else "")
        return LLMReading(program, (note,), exchanges=tuple(record))

    def _program(
        self,
        text: str,
        counts: Mapping[str, int],
        rooms: Sequence[str],
        check: Check | None,
        record: list[Exchange],
        cancel: threading.Event | None,
    ) -> tuple[str, int]:
        """Return a valid program, and how many repairs it took."""
        more: list[Message] = []
        reason = ""

        def compose(structured: bool) -> list[Message]:
            return [*command_messages(text, counts, rooms, structured=structured), *more]

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
    """Refuse every class written in a program that a map lacks.

    Raises:
        CommandError: naming line, primitive, the class, and all the map has.
    """
    vocabulary = Vocabulary(counts)
    for call in program.calls:
        if call.primitive.kind == "function":
            continue  # of a name that a map lacks, a function makes the empty set, which says so where it is used
        for parameter in call.primitive.parameters:
            value = call.constant(parameter.name)
            asks_itself = call.primitive.name == "get_pos" and value == SELF
            named = parameter.type in ("label", "object") and isinstance(value, str) and not asks_itself
            if named and not vocabulary.resolve(str(value)):
                has = ", ".join(f"{label} ({n})" for label, n in counts.items()) or "no objects at all"
                message = f"There is no {value} on this map. It has: {has}."
                raise ProgramError(call.line, call.primitive.name, message)


SCHEMA: Final[dict[str, Any]] = {
    "type": "object",
    "properties": {"program": {"type": "string"}, "refusal": {"type": ["string", "null"]}},
    "required": ["program", "refusal"],
    "additionalProperties": False,
}
"""JSON schema of the answer to a command."""

_STRUCTURED = """Answer with one JSON object and nothing else: {"program": the program, "refusal": null}, or, \
to refuse, {"program": "", "refusal": the reason}."""
_PLAIN = """Answer with the program in one fenced code block and nothing else, or, to refuse, with one line: \
REFUSED: the reason."""
_EXAMPLES: Final = load("prompt_examples.json")
"""Examples: the counts of the map, commands with their programs, line by line, and refusals."""
_NOTHING: Final = frozenset(("", "null", "none", "n/a", "no"))
_MAX_CLASSES = 200
_THOUGHT: Final = re.compile(r"<think(?:ing)?>.*?</think(?:ing)?>", re.DOTALL | re.IGNORECASE)
_FENCE: Final = re.compile(r"^[ \t]*```[^\n`]*\n(.*?)^[ \t]*```", re.DOTALL | re.MULTILINE)
_REFUSED: Final = re.compile(r"^\W*REFUSED?\b\W*(.*)", re.DOTALL | re.IGNORECASE)


def command_messages(
    command: str, counts: Mapping[str, int], rooms: Sequence[str] = (), *, structured: bool
) -> list[Message]:
    """Return the conversation up to and with a command."""
    messages = [Message("system", _system(structured))]
    for said, text, refusal in _worked_examples():
        messages.append(Message("user", _question(said, _EXAMPLES["counts"])))
        messages.append(Message("assistant", _written(text, refusal, structured)))
    return [*messages, Message("user", _question(command, counts, rooms))]


def repair_messages(answer: str, error: str) -> list[Message]:
    """Return the messages to add to a conversation after an answer that cannot be executed."""
    request = f"That cannot be carried out: {error}\nAnswer again in the same form, corrected, or refuse."
    return [Message("assistant", answer or "(nothing)"), Message("user", request)]


def read_answer(text: str) -> tuple[str, str]:
    """Read a model's answer, in either form, as (program, refusal), one of them empty.

    Raises:
        CommandError: when there is neither in it.
    """
    text = _THOUGHT.sub("", text).strip()
    blocks = _FENCE.findall(text + "\n")
    for candidate in (text, *reversed(blocks)):
        found = _object(candidate)
        if found is not None and ("program" in found or "refusal" in found):
            refusal = _words(found.get("refusal"))
            return ("", refusal) if refusal else (_code(_words(found.get("program"))), "")
    if blocks:
        return _code(blocks[-1]), ""
    refused = _REFUSED.match(text)
    if refused:
        return "", refused[1].strip() or "no reason given"
    if not text:
        raise CommandError("the answer is empty")
    return _code(text), ""


@cache
def _system(structured: bool) -> str:
    fields = {
        "calls": "\n".join(f"- robot.{p.typed}: {p.meaning}" for p in PRIMITIVES.values()),
        "functions": "\n".join(f"- {p.typed}: {p.meaning}" for p in FUNCTIONS.values()),
        "kinds": "\n".join(f"- {kind}: {meaning}" for kind, meaning in ARGUMENT_KINDS.items()),
        "form": _STRUCTURED if structured else _PLAIN,
    }
    text = load_text("prompt.md").strip()
    for name, value in fields.items():
        text = text.replace(f"{{{name}}}", value)
    return text


@cache
def _worked_examples() -> tuple[tuple[str, str, str], ...]:
    """Return (command, program, refusal)."""
    done = [(one["said"], "\n".join(one["program"]), "") for one in _EXAMPLES["commands"]]
    return (*done, *((said, "", reason) for said, reason in _EXAMPLES["refusals"].items()))


def _written(text: str, refusal: str, structured: bool) -> str:
    if structured:
        return json.dumps({"program": text, "refusal": refusal or None})
    return f"REFUSED: {refusal}" if refusal else f"```python\n{text}\n```"


def _question(command: str, counts: Mapping[str, int], rooms: Sequence[str] = ()) -> str:
    shown = dict(list(counts.items())[:_MAX_CLASSES])
    has = {label[:MAX_TEXT]: n for label, n in shown.items()}
    named = f"\nIts rooms: {_data([name[:MAX_TEXT] for name in rooms[:_MAX_CLASSES]])}" if rooms else ""
    return f"On the map, class and how many: {_data(has)}{named}\nCommand: {_data(command)}"


def _data(value: object) -> str:
    """Quote foreign text, so that it cannot end its line or its quotes."""
    return json.dumps(value, ensure_ascii=False).encode("utf-8", "replace").decode("utf-8")


def _object(text: str) -> dict[str, Any] | None:
    """Return the JSON object a text is, or the one from its first to its last brace, if any."""
    whole = text.strip()
    for piece in (whole, whole[whole.find("{") : whole.rfind("}") + 1]):
        if piece.startswith("{"):
            try:
                found = json.loads(piece, strict=False)
            except (ValueError, RecursionError):
                continue
            if isinstance(found, dict):
                return found
    return None


def _words(value: object) -> str:
    text = value.strip("\n") if isinstance(value, str) else ""
    return "" if text.strip().lower() in _NOTHING else text


def _code(text: str) -> str:
    """Return program text without the wrapping models put around it."""
    block = _FENCE.search(text + "\n")
    code = textwrap.dedent((block[1] if block else text).replace("\r\n", "\n")).strip()
    if not code:
        raise CommandError("there is neither a program nor a refusal in the answer")
    return code
