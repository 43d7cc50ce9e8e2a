"""One thread for all the work a click can cause. A later job of the same name replaces an earlier one in waiting."""

import threading
from collections import OrderedDict
from collections.abc import Callable

Job = Callable[[], None]


class Worker:
    """Runs jobs one after another, off the threads that serve the page.

    A slider sends many values a second: only the latest that waits is worth computing.
    """

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        """Start the thread; ``on_error`` is told what a job raised."""
        self._on_error = on_error
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._changed = threading.Condition()
        self._busy = False
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="workbench-worker", daemon=True)
        self._thread.start()

    def submit(self, name: str, job: Job) -> None:
        """Queue a job; one of the same name that has not begun is dropped."""
        with self._changed:
            self._jobs[name] = job
            self._changed.notify_all()

    def wait_idle(self, timeout_s: float = 10.0) -> bool:
        """Wait until nothing runs or waits; False when that took too long."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._jobs and not self._busy, timeout_s)

    def stop(self) -> None:
        """Drop what waits and end the thread once the running job is done."""
        with self._changed:
            self._stopped = True
            self._jobs.clear()
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=10.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._jobs) or self._stopped)
                if self._stopped:
                    return
                _, job = self._jobs.popitem(last=False)
                self._busy = True
            try:
                job()
            except Exception as error:  # whatever a job does, the page must live on
                self._on_error(error)
            finally:
                with self._changed:
                    self._busy = False
                    self._changed.notify_all()
