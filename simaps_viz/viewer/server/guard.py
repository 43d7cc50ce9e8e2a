"""Makes what a page's callbacks raise appear on that page."""

import contextlib
from collections.abc import Callable
from typing import Any

import viser


class _GuardedPool:
    """Runs callbacks as the server's own threads do, and tells one page what they raise."""

    def __init__(self, pool: Any, report: Callable[[Exception], None]) -> None:
        self._pool, self._report = pool, report

    def submit(self, callback: Callable[..., Any], *arguments: Any) -> Any:
        return self._pool.submit(self._run, callback, *arguments)

    def _run(self, callback: Callable[..., Any], *arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # whatever happens, the page must live on
            self._report(error)


def guard(client: viser.ClientHandle, report: Callable[[Exception], None]) -> None:
    """Make the errors of every callback of a page, whoever wrote it, appear on that page.

    viser 1.1.1 would print them and go on. It also warns of what a thread still sends when its page has just been
    closed, which nobody can help.
    """
    for api in (client.gui, client.scene):
        api._thread_executor = _GuardedPool(api._thread_executor, report)  # pyright: ignore[reportAttributeAccessIssue]
    with contextlib.suppress(AttributeError):
        client._websock_connection.get_message_buffer()._warned_push_after_done = True
