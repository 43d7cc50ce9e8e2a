"""A conversation with one model; it can be cancelled, and adapts to the features that the server supports."""

import asyncio
import json
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Literal

from simaps_viz.language.llm_settings import (
    Exchange,
    LLMCancelledError,
    LLMServerError,
    LLMSettings,
    Message,
    one_line,
    said_in,
    without_key,
)
from simaps_viz.language.program import MAX_SOURCE

MAX_ANSWER: Final = 2 * MAX_SOURCE
"""Characters of a model's answer."""
_LOOK_S: Final = 0.02  # how often a wait looks whether it was cancelled

Compose = Callable[[bool], Sequence[Message]]
"""(whether the server holds the model to a schema) -> the messages to send."""


@dataclass(frozen=True)
class Dialect:
    """The features of the protocol that a server or model supports."""

    structured: bool = True
    """Holds the answer to a JSON schema."""
    temperature: bool = True
    limit: Literal["max_tokens", "max_completion_tokens"] = "max_tokens"

    def plainer(self, complaint: str) -> "Dialect | None":
        """Return the features to use after an error about a request; None when no alternative is left."""
        if self.limit == "max_tokens" and "max_completion_tokens" in complaint:
            return replace(self, limit="max_completion_tokens")
        if self.temperature and "temperature" in complaint:
            return replace(self, temperature=False)
        return replace(self, structured=False) if self.structured else None


class Chat:
    """Asks one model. May be used from several threads.

    Args:
        settings: which, and where.
    """

    def __init__(self, settings: LLMSettings) -> None:
        self.settings = settings
        self.dialect = Dialect()
        """Remembered from question to question."""

    def ask(
        self,
        compose: Compose,
        schema: dict[str, Any],
        record: Callable[[Exchange], None],
        cancel: threading.Event | None = None,
    ) -> str:
        """Ask one question; returns the model's text.

        Args:
            compose: makes the messages.
            schema: JSON schema of the answer, for servers that can hold the model to one.
            record: gets every exchange, also those that failed.
            cancel: set it to have the wait end at once and the connection closed.

        Raises:
            LLMServerError, LLMCancelledError.
        """
        dialect = self.dialect
        while True:
            messages = tuple(compose(dialect.structured))
            try:
                text = self._exchange(messages, self._request(messages, schema, dialect), record, cancel)
            except LLMServerError as error:
                plainer = dialect.plainer(str(error)) if error.status in (400, 422) else None
                if plainer is None:
                    raise
                dialect = plainer
                continue
            self.dialect = dialect
            return text

    def _request(self, messages: Sequence[Message], schema: dict[str, Any], dialect: Dialect) -> dict[str, Any]:
        request: dict[str, Any] = {
            "model": self.settings.model,
            "messages": [asdict(message) for message in messages],
            dialect.limit: self.settings.max_tokens,
        }
        if dialect.temperature:
            request["temperature"] = self.settings.temperature
        if dialect.structured:
            wanted = {"name": "answer", "strict": True, "schema": schema}
            request["response_format"] = {"type": "json_schema", "json_schema": wanted}
        return request

    def _exchange(
        self,
        messages: tuple[Message, ...],
        request: dict[str, Any],
        record: Callable[[Exchange], None],
        cancel: threading.Event | None,
    ) -> str:
        key = self.settings.key()
        begun = time.monotonic()
        text, failure = "", None
        try:
            body = _Call(self.settings, key, request).wait(cancel)
            text = without_key(_answer_of(body, key, self.settings), key)
        except (LLMServerError, LLMCancelledError) as error:
            failure = error
        record(Exchange(messages, text, time.monotonic() - begun, str(failure) if failure else None))
        if failure:
            raise failure
        return text


class _Call:
    """One request on its own thread and event loop, so that a cancelled caller need not wait for its end."""

    def __init__(self, settings: LLMSettings, key: str, request: dict[str, Any]) -> None:
        self._settings, self._key, self._request = settings, key, request
        self._over, self._given_up = threading.Event(), threading.Event()
        self._body = b""
        self._error: BaseException | None = None

    def wait(self, cancel: threading.Event | None) -> bytes:
        """Return the body of the response, or raise what went wrong; LLMCancelledError as soon as ``cancel`` is set."""
        thread = threading.Thread(target=self._run, name="language model", daemon=True)
        try:
            while not self._over.wait(_LOOK_S if thread.ident else 0.0):
                if cancel is not None and cancel.is_set():
                    raise LLMCancelledError(f"{self._settings}: cancelled")
                if not thread.ident:
                    thread.start()
        finally:
            self._given_up.set()
        if self._error is not None:
            raise self._error
        return self._body

    def _run(self) -> None:
        try:
            self._body = asyncio.run(self._post())
        except BaseException as error:  # handed on to whoever waits
            self._error = error
        finally:
            self._over.set()

    async def _post(self) -> bytes:
        from simaps_viz.language.llm_http import post  # noqa: PLC0415 - its client is slow to load

        asking = asyncio.create_task(post(self._settings, self._key, self._request))
        while not asking.done():
            await asyncio.wait({asking}, timeout=_LOOK_S)
            if self._given_up.is_set():
                asking.cancel()  # closes the connection, so that the server can stop working
        return asking.result()


def _answer_of(body: bytes, key: str, settings: LLMSettings) -> str:
    """Return the model's text in the body of a response, or raise LLMServerError."""

    def fail(what: str) -> LLMServerError:
        return LLMServerError(f"{settings}: {what}")

    try:
        completion = json.loads(body.decode("utf-8"))
    except (ValueError, RecursionError):
        raise fail("what came back is not JSON in UTF-8; is it a chat-completions server?") from None
    choices = completion.get("choices") if isinstance(completion, dict) else None
    choice = choices[0] if isinstance(choices, list) and choices else None
    message = choice.get("message") if isinstance(choice, dict) else None
    if not isinstance(choice, dict) or not isinstance(message, dict):
        said = one_line(without_key(said_in(completion), key))
        raise fail(f"the server sent no answer{f': {said}' if said else ''}")
    text = message.get("content")
    text = text if isinstance(text, str) else ""
    if choice.get("finish_reason") == "length":
        raise fail(f"the answer was cut off at the limit of {settings.max_tokens} tokens")
    if choice.get("finish_reason") == "content_filter":
        raise fail("the server withheld the answer (content filter)")
    if len(text) > MAX_ANSWER:
        raise fail(f"the answer is too long: expected at most {MAX_ANSWER} characters, found {len(text)}")
    refusal = message.get("refusal")
    if not text.strip() and isinstance(refusal, str) and refusal.strip():
        return json.dumps({"program": "", "refusal": refusal[:MAX_ANSWER]})
    return text
