"""A queue of jobs with one thread; a later job replaces a waiting one of the same name."""

import threading
from collections import OrderedDict
from collections.abc import Callable

Job = Callable[[], object]


class Worker:
    """Runs jobs one after another. A slider sends many values a second: only the latest waiting one is computed.

    The thread exists only while there are jobs, so that an idle page has none.
    """

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        """Take the function that is called with an error of a job."""
        self._on_error = on_error
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._stopped = False

    def submit(self, name: str, job: Job) -> None:
        """Queue a job in place of a waiting one of the same name. After ``stop`` nothing is queued."""
        with self._changed:
            if self._stopped:
                return
            self._jobs[name] = job
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="workbench-worker", daemon=True)
                self._thread.start()

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until all jobs are done; False when that took too long."""
        with self._changed:
            return self._changed.wait_for(lambda: self._thread is None, timeout_s)

    def stop(self, timeout_s: float = 10.0) -> None:
        """Drop the waiting jobs and wait for the running one; its errors are no longer reported."""
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
            except Exception as error:  # no job may end the page
                if not self._stopped:
                    self._on_error(error)
