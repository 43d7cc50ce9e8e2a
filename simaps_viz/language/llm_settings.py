"""Settings of the language model and its server, and the errors of asking it."""

import ipaddress
import os
import re
from dataclasses import dataclass
from typing import Final
from urllib.parse import SplitResult, urlsplit

from simaps_viz.errors import CommandError, InputError

OPENAI_URL: Final = "https://api.openai.com/v1"
PLACEHOLDER_KEY: Final = "no-key-needed"
"""Sent where there is no key: local servers ask for none, but the client insists on sending one."""
_FORM: Final = "expected MODEL or MODEL@ADDRESS, for example qwen2.5:7b@http://127.0.0.1:11434/v1"
_SPEC: Final = re.compile(r"(?P<model>.*?)@(?P<url>[A-Za-z][A-Za-z0-9+.-]*://.*)", re.DOTALL)
_SECRET: Final = 8
_KEY: Final = re.compile(r"[!-~]+")


@dataclass(frozen=True)
class LLMSettings:
    """A chat-completions server and a model on it. The key itself is never kept here, only the name of its variable.

    Raises:
        InputError: when a value cannot be.
    """

    base_url: str
    """Address up to and without ``/chat/completions``; without a path it gets ``/v1``."""
    model: str
    api_key_env: str = "OPENAI_API_KEY"
    """Environment variable that holds the key."""
    timeout_s: float = 30.0
    """Longest wait for one answer, retries and the waits between them included."""
    retries: int = 2
    """How often a request is sent again after a lost connection, 429 or 5xx."""
    temperature: float = 0.0
    max_tokens: int = 2_000
    """Limit of one answer; models that write down their reasoning need some."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_url", _tidy_url(self.base_url))
        if not self.model.strip() or not self.model.isprintable():
            raise InputError(f"language model: {_FORM}, found no name of a model")
        for name, least in (("timeout_s", 0.01), ("retries", 0), ("temperature", 0.0), ("max_tokens", 1)):
            if not least <= getattr(self, name) <= 1e6:
                raise InputError(f"language model: {name}: expected {least:g} or more, found {getattr(self, name)}")

    @property
    def host(self) -> str:
        """Name or number of the server's machine."""
        return urlsplit(self.base_url).hostname or ""

    @property
    def is_local(self) -> bool:
        """Return whether the server runs on this very machine."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def may_carry_key(self) -> bool:
        """Return whether a key may be sent there: over an unencrypted network it may not."""
        return self.is_local or self.base_url.startswith("https://")

    def key(self) -> str:
        """Read the key from the environment; a placeholder where none is needed or none may go.

        Raises:
            InputError: naming the variable, never its value.
        """
        key = os.environ.get(self.api_key_env, "").strip() if self.may_carry_key else ""
        if key and not _KEY.fullmatch(key):
            raise InputError(f"{self.api_key_env}: expected a key of plain letters, digits and signs, found others")
        if not key and self.may_carry_key and not self.is_local:
            raise InputError(f"{self.base_url} asks for a key: set the variable {self.api_key_env}")
        return key or PLACEHOLDER_KEY

    def __str__(self) -> str:
        return f"{self.model} at {self.base_url}"


def parse_llm_spec(text: str) -> LLMSettings:
    """Read what stands after ``--llm``: MODEL, which is OpenAI's, or MODEL@ADDRESS.

    Raises:
        InputError: when it is neither. The address is not repeated where it may hold a secret.
    """
    spec = text.strip()
    with_address = _SPEC.fullmatch(spec)
    if with_address:
        return LLMSettings(with_address["url"], with_address["model"].strip())
    if "@" in spec[1:]:
        raise InputError(f"--llm: {_FORM}; the address begins with http:// or https://")
    return LLMSettings(OPENAI_URL, spec)


def _tidy_url(text: str) -> str:
    where = "language model: address"
    try:
        parts: SplitResult = urlsplit(text.strip())
        port_is_good = parts.port is None or parts.port > 0
    except ValueError:
        raise InputError(f"{where}: expected e.g. http://127.0.0.1:11434/v1, found something unreadable") from None
    if "@" in parts.netloc:
        raise InputError(f"{where}: expected no user name or password in it; a key comes from the environment")
    if parts.query or parts.fragment:
        raise InputError(f"{where}: expected nothing after ? or #; a key comes from the environment")
    if parts.scheme not in ("http", "https"):
        raise InputError(f"{where}: expected http:// or https://, found {parts.scheme[:20] or 'neither'}")
    if not parts.hostname or not port_is_good or not text.strip().isprintable() or re.search(r"\s", text.strip()):
        raise InputError(f"{where}: expected e.g. http://127.0.0.1:11434/v1, found {text.strip()[:80]!r}")
    path = parts.path.rstrip("/").removesuffix("/chat/completions") or "/v1"
    return f"{parts.scheme}://{parts.netloc}{path}"


@dataclass(frozen=True)
class Message:
    """One turn of a conversation with a model."""

    role: str
    """Either system, user or assistant."""
    content: str


@dataclass(frozen=True)
class Exchange:
    """One request to the server and its response, to be shown; neither contains the key."""

    messages: tuple[Message, ...]
    response: str
    """The model's text; empty when there was none."""
    seconds: float
    error: str | None = None
    """Why there was none, in words."""


class LLMError(CommandError):
    """A language model returned no program; holds the requests and responses."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.exchanges: tuple[Exchange, ...] = ()


class LLMServerError(LLMError):
    """The server could not be reached, or its response is invalid; the command may still be valid."""

    def __init__(self, message: str, status: int | None = None) -> None:
        super().__init__(message)
        self.status = status


class LLMRefusedError(LLMError):
    """The model refused the command, or wrote no valid program for it."""


class LLMCancelledError(LLMError):
    """Whoever asked did not want to wait any longer."""


def one_line(text: str, most: int = 200) -> str:
    """Return foreign text as one short line of printable characters."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= most else f"{line[: most - 1]}…"


def without_key(text: str, key: str) -> str:
    """Return a text with the key replaced, should a server have sent it back; short keys are no secrets."""
    return text if key == PLACEHOLDER_KEY or len(key) < _SECRET else text.replace(key, "•••")


def said_in(body: object) -> str:
    """Return the message in the body of an error; servers nest it in different ways."""
    if isinstance(body, dict):
        return next((said_in(body[name]) for name in ("message", "error", "detail") if body.get(name)), "")
    text = body if isinstance(body, str) else ""
    return "" if text.lstrip().startswith("<") else text
