"""One request to a chat-completions server: bounded in time and size, and without secrets.

This module imports the client, which is slow to load; it is itself imported only when a model is asked.
"""

import asyncio
from collections.abc import AsyncIterator
from typing import Any, Final

import httpx2
import openai

from simaps_viz.language.llm_settings import OPENAI_URL, LLMServerError, LLMSettings, one_line, said_in, without_key

MAX_BODY: Final = 1 << 20
"""Bytes of a response."""
_CONNECT_S: Final = 10.0
_ASKS_FOR_BYTES: Final = "x-stainless-raw-response"  # the client reads it back from the request


async def post(settings: LLMSettings, key: str, request: dict[str, Any]) -> bytes:
    """Send a request; returns the body of a good response.

    Local servers are reached directly, whatever proxies the environment names; redirects are never followed.

    Raises:
        LLMServerError: in one line, without the key; ``status`` is that of the response, if there was one.
    """
    statuses: list[int] = []
    try:
        async with asyncio.timeout(settings.timeout_s), _client(settings, key, statuses) as client:
            response = await client.chat.completions.with_raw_response.create(**request)
            return response.content
    except TimeoutError:
        busy = "too many requests (429), and " if statuses[-1:] == [429] else ""
        raise LLMServerError(f"{settings}: {busy}no answer within {settings.timeout_s:g} s") from None
    except openai.APIStatusError as error:
        raise LLMServerError(f"{settings}: {_refusal(settings, error, key)}", error.status_code) from None
    except openai.APIConnectionError as error:
        raise LLMServerError(f"{settings}: {_lost(error.__cause__)}") from None
    except (openai.OpenAIError, httpx2.HTTPError, httpx2.InvalidURL) as error:
        raise LLMServerError(f"{settings}: {one_line(without_key(str(error), key))}") from None


def _client(settings: LLMSettings, key: str, statuses: list[int]) -> openai.AsyncOpenAI:
    async def trim(request: httpx2.Request) -> None:
        # no details of this system are sent; only OpenAI has accounts
        foreign = "x-stainless-" if settings.base_url == OPENAI_URL else ("x-stainless-", "openai-")
        for name in list(request.headers):
            if name.lower().startswith(foreign) and name.lower() != _ASKS_FOR_BYTES:
                del request.headers[name]

    async def limit(response: httpx2.Response) -> None:
        statuses.append(response.status_code)
        packed = response.headers.get("content-encoding", "identity") != "identity"
        if packed:  # was not asked for; small packed bodies can unpack to huge ones
            raise LLMServerError(f"{settings}: answers with a packed body, which was not asked for")
        if isinstance(response.stream, httpx2.AsyncByteStream):
            response.stream = _Limited(response.stream, str(settings))

    transport = httpx2.AsyncClient(
        trust_env=not settings.is_local,
        follow_redirects=False,
        timeout=httpx2.Timeout(settings.timeout_s, connect=_CONNECT_S),
        headers={"Accept-Encoding": "identity"},
        event_hooks={"request": [trim], "response": [limit]},
    )
    return openai.AsyncOpenAI(
        api_key=key, base_url=settings.base_url, max_retries=settings.retries, http_client=transport
    )


class _Limited(httpx2.AsyncByteStream):
    """A response that ends in an error once it is too long."""

    def __init__(self, stream: httpx2.AsyncByteStream, source: str) -> None:
        self._stream, self._source = stream, source

    async def __aiter__(self) -> AsyncIterator[bytes]:
        read = 0
        async for part in self._stream:
            read += len(part)
            if read > MAX_BODY:
                raise LLMServerError(f"{self._source}: the answer is longer than {MAX_BODY >> 20} MiB")
            yield part

    async def aclose(self) -> None:
        await self._stream.aclose()


def _refusal(settings: LLMSettings, error: openai.APIStatusError, key: str) -> str:
    """Explain an HTTP error status to the person who typed the command."""
    status = error.status_code
    said = one_line(without_key(said_in(error.body), key))
    said = f": {said}" if said else ""
    if status == 401:  # the messages of servers repeat parts of the key here
        if not settings.may_carry_key:
            return "unauthorised (401); a key is only sent over https or to this machine"
        return f"unauthorised (401): set the variable {settings.api_key_env} to a key this server takes"
    if status == 404:
        return f"no model of this name there, or no such address (404){said}"
    if 300 <= status < 400:
        return f"sends on to another address ({status}), which is not followed; give the final address"
    words = {403: "forbidden", 429: "too many requests", 400: "refuses the request", 413: "the request is too large"}
    return f"{words.get(status, 'the server failed' if status >= 500 else 'refuses the request')} ({status}){said}"


def _lost(cause: BaseException | None) -> str:
    if isinstance(cause, httpx2.ConnectError | httpx2.ConnectTimeout):
        return "no server answers at this address"
    if isinstance(cause, httpx2.TimeoutException):
        return "the connection went silent"
    return "the connection broke off before the answer was there"
