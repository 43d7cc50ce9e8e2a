"""One person's work, off the threads that serve the page, one job after another; a later job of a name replaces it."""

import threading
from collections import OrderedDict
from collections.abc import Callable

Job = Callable[[], None]


class Worker:
    """Runs jobs in the order they came. A slider sends many values a second: only the latest that waits is computed.

    It has a thread only while there is work, so that a page that nobody touches costs none.
    """

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        """Take whom to tell what a job raised."""
        self._on_error = on_error
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._stopped = False

    def submit(self, name: str, job: Job) -> None:
        """Queue a job; one of the same name that has not begun is dropped. After ``stop`` nothing is queued."""
        with self._changed:
            if self._stopped:
                return
            self._jobs[name] = job
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="workbench-worker", daemon=True)
                self._thread.start()

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until nothing runs or waits; False when that took too long."""
        with self._changed:
            return self._changed.wait_for(lambda: self._thread is None, timeout_s)

    def stop(self, timeout_s: float = 10.0) -> None:
        """Drop what waits and wait for the running job; errors are told no more."""
        with self._changed:
            self._stopped = True
            self._jobs.clear()
            running = self._thread
        if running is not None and running is not threading.current_thread():
            running.join(timeout=timeout_s)

    def _run(self) -> None:
        while True:
            with self._changed:
                if not self._jobs:
                    self._thread = None
                    self._changed.notify_all()
                    return
                _, job = self._jobs.popitem(last=False)
            try:
                job()
            except Exception as error:  # whatever a job does, the page must live on
                if not self._stopped:
                    self._on_error(error)
