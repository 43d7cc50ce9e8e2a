"""Workers of a Dask cluster, or processes of this machine, gather the frames of a build; see `pipeline.RemoteGatherer`.

Shards are handed out in the order of their frames, a few for each worker ahead of their use, and taken back in that
order: a shard done early waits on its worker, so that this process holds one shard at a time. When a worker dies, Dask
gives its shards to another, those that were done but not fetched included.
"""

import logging
import re
import signal
import socket
import struct
import threading
import time
import warnings
import zlib
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.metadata import version
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from numpy.typing import NDArray

from simaps_viz.build.pipeline import content_of
from simaps_viz.console.logs import logger
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.source import FrameSource, JoinedFrames
from simaps_viz.errors import InputError, needs_extra
from simaps_viz.mapping import finalize
from simaps_viz.mapping.config import BuildConfig
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.steps import FrameStep, compress, decompress, pack_step, unpack_step
from simaps_viz.segmentation.sequences import masks_from

if TYPE_CHECKING:
    from distributed import Client, Future

    _Waiting = tuple[Sequence[int], Future]  # a shard, and what will be its steps


_HEAD = struct.Struct("<II")
SHARD_FRAMES = 16
"""Frames handed out together: some 0.1 s of work, against 2 ms for handing them out."""


@dataclass(frozen=True)
class Reopen:
    """Opens a sequence again, on another machine: the paths have to mean the same there."""

    parts: tuple[tuple[str, str], ...]
    """(absolute path, who made the segmentation) of each sequence."""
    masks: str
    """Folder of kept masks, for segmentation that the sequence does not bring along."""
    joined: bool = False
    """They are joined to one."""

    def __call__(self) -> FrameSource:
        """Open it; frames that are missing are for the build to skip.

        Raises:
            InputError: it is not there, or is something else.
        """
        opened = [self._open(Path(path), source) for path, source in self.parts]
        return JoinedFrames(opened) if self.joined else opened[0]

    def _open(self, path: Path, source: str) -> FrameSource:
        sequence = open_sequence(path)
        if source == sequence.segmentation_source:
            return sequence
        masked = masks_from(sequence, source, Path(self.masks))
        if masked is None:
            raise InputError(f"{self.masks}: expected the masks of {source} for {path}, found none")
        return masked


def reopening(sequence: FrameSource, masks: Path) -> Reopen:
    """Describe how a sequence is opened again.

    Args:
        sequence: one that was opened from its path, or several joined.
        masks: folder of kept masks.
    """
    joined = isinstance(sequence, JoinedFrames)
    parts = sequence.sequences if joined else (sequence,)
    return Reopen(tuple((str(p.path.resolve()), p.segmentation_source) for p in parts), str(masks.resolve()), joined)


@dataclass(frozen=True)
class Job:
    """What is the same for all shards of a build; small, as it travels with each."""

    reopen: Callable[[], FrameSource]
    """Can be pickled and hashed."""
    content: str
    """Hash of the sequence where the build was started, see `content_of`."""
    version: str
    """Version of this package where the build was started."""
    config: BuildConfig
    labels: tuple[str, ...]
    is_thing: tuple[bool, ...]


def job_of(sequence: FrameSource, config: BuildConfig, reopen: Callable[[], FrameSource]) -> Job:
    """Describe what a build's shards have in common."""
    return Job(reopen, content_of(sequence), version("simaps-viz"), config, sequence.labels, sequence.is_thing)


def gather_shard(job: Job, indices: Sequence[int], T_map_camera: NDArray) -> bytes:
    """Gather frames, ascending, and return all that they add to a map; unreadable frames are marked as such.

    Args:
        job: of which build.
        indices: of the frames.
        T_map_camera: float64 [indices, 4, 4], computed by the process that started the build: the last bit of a product
            of matrices depends on the machine.

    Raises:
        InputError: the sequence is not here, is another one, or cannot be mapped.
    """
    sequence = _opened(job.reopen, job.content, job.version)
    accumulator = finalize.empty_accumulator(job, job.config, steps=True)
    packed = []
    for index, pose in zip(indices, T_map_camera, strict=True):
        try:
            frame, segmentation = sequence.read(index), sequence.segmentation(index)
        except InputError as error:
            accumulator.skip_frame(index, sequence.frame_names[index], pose, str(error))
        else:
            accumulator.add_frame(frame, segmentation, pose)
        assert accumulator.step is not None  # steps were asked for
        packed.append(_sealed(accumulator.step, links=method_of(job.config.method).counts_links))
    return b"".join(packed)


def steps_in(data: bytes, indices: Sequence[int]) -> Iterator[FrameStep]:
    """Read what `gather_shard` returned for these frames.

    Raises:
        ValueError: it is something else.
    """
    at = 0
    for index in indices:
        if at + _HEAD.size > len(data):
            raise ValueError("fewer frames than asked for")
        length, crc = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        content = data[at : at + length]
        if len(content) != length or zlib.crc32(content) != crc:
            raise ValueError("damaged on the way")
        try:
            step = unpack_step(decompress(content))
        except (KeyError, TypeError, struct.error) as error:
            raise ValueError(f"no frame's step ({type(error).__name__})") from error
        if step.seen.index != index:
            raise ValueError(f"frame {step.seen.index} in place of {index}")
        at += length
        yield step


def _sealed(step: FrameStep, *, links: bool) -> bytes:
    content = compress(pack_step(step if links else replace(step, links=None)))
    return _HEAD.pack(len(content), zlib.crc32(content)) + content


@lru_cache(maxsize=2)
def _opened(reopen: Callable[[], FrameSource], content: str, wanted: str) -> FrameSource:
    """Open a sequence once for all shards of a build; a change of it is a new one."""
    here = version("simaps-viz")
    if here != wanted:
        raise InputError(f"expected simaps-viz {wanted} as where the build was started, found {here}")
    sequence = reopen()
    if content_of(sequence) != content:
        raise InputError(
            f"{sequence.path}: expected the sequence that is being built, found other frames, poses, cameras or tables"
        )
    return sequence


SHARDS_AHEAD = 3
"""For each thread of the workers: the one it works on and two more."""
MAX_LOCAL = 256
PATIENCE_S = 30.0
"""Seconds that a build waits for a worker when all are gone."""
_CONNECT_S, _FETCH_S, _POLL_S, _LOOK_S = 10.0, 20.0, 0.2, 2.0
_MAX_GREETING = 1 << 16  # bytes; the greeting of a scheduler begins with its length


@dataclass
class Moved:
    """Frames and bytes received, and the time this process spent on them."""

    frames: int = 0
    received: int = 0
    """Bytes of steps that came back."""
    waited_s: float = 0.0
    """Spent waiting for a shard to be done."""
    fetched_s: float = 0.0
    """Spent on fetching it from its worker."""
    unpacked_s: float = 0.0
    """Spent on unpacking it; putting it on the grid comes after that."""


@dataclass
class Workers:
    """Gathers frames on the workers of a cluster; made by `open_workers`."""

    client: "Client"
    scheduler: str
    """As the user wrote it."""
    reopen: Callable[[], FrameSource]
    """Opens the sequence on a worker."""
    shard_frames: int = SHARD_FRAMES
    moved: Moved = field(default_factory=Moved)
    _known: int = 0
    """Workers there were when they were last counted."""
    _looked: float = 0.0
    _alone_since: float | None = None

    def __call__(
        self, sequence: FrameSource, config: BuildConfig, T_map_camera: NDArray, indices: Sequence[int]
    ) -> Generator[FrameStep | None, None, None]:
        """Gather frames, see `pipeline.RemoteGatherer`.

        Raises:
            InputError: a worker lacks the sequence or has another one, no worker is left, or the scheduler is gone.
        """
        job = job_of(sequence, config, self.reopen)
        shards = (indices[first : first + self.shard_frames] for first in range(0, len(indices), self.shard_frames))
        waiting: deque[_Waiting] = deque()
        try:
            with self._gone_in_one_line():
                yield from self._in_order(job, shards, T_map_camera, waiting)
        finally:
            if waiting and self.client.status == "running":
                self.client.cancel([future for _, future in waiting], force=True)

    def count(self) -> int:
        """Count the workers there are."""
        return len(_threads(self.client))

    def _in_order(
        self, job: Job, shards: Iterator[Sequence[int]], T_map_camera: NDArray, waiting: "deque[_Waiting]"
    ) -> Generator[FrameStep | None, None, None]:
        while True:
            ahead = SHARDS_AHEAD * max(1, sum(_threads(self.client).values()))
            for shard in islice(shards, max(0, ahead - len(waiting))):
                poses = T_map_camera[list(shard)]
                waiting.append((shard, self.client.submit(_on_worker, job, shard, poses, pure=False, retries=0)))
            if not waiting:
                return
            shard, future = waiting[0]
            data = None
            while data is None:
                yield from self._done(future)
                data = self._fetched(shard, future)
            waiting.popleft()
            yield from self._unpacked(data, shard)

    @contextmanager
    def _gone_in_one_line(self) -> Iterator[None]:
        from distributed import CancelledError  # noqa: PLC0415 - an extra, and slow to import

        try:
            yield
        except (CancelledError, OSError):
            raise InputError(
                f"--scheduler {self.scheduler}: expected it to stay until the build is done, found it gone; "
                "--resume continues from what is done"
            ) from None

    def _done(self, future: "Future") -> Generator[None, None, None]:
        """Wait until a shard is done; yields None every so often."""
        done, start = threading.Event(), time.perf_counter()
        future.add_done_callback(lambda _: done.set())
        while not done.wait(_POLL_S):
            self._look()
            yield None
        self.moved.waited_s += time.perf_counter() - start

    def _look(self) -> None:
        """Count the workers every so often; log when some are gone, and raise InputError when none comes back."""
        now = time.monotonic()
        if now - self._looked < _LOOK_S:
            return
        self._looked = now
        there = self.count() if self.client.status == "running" else 0
        if there != self._known:
            logger.warning("workers: %d, were %d", there, self._known, extra={"event": "workers", "workers": there})
            self._known = there
        if there:
            self._alone_since = None
        elif self._alone_since is None:
            self._alone_since = now
        elif now - self._alone_since > PATIENCE_S:
            raise InputError(
                f"--scheduler {self.scheduler}: expected a worker, found none for {PATIENCE_S:.0f} s; "
                "--resume continues from what is done"
            )

    def _fetched(self, shard: Sequence[int], future: "Future") -> bytes | None:
        """Fetch a shard that is done; None when it does not come, as its worker has died since."""
        from distributed.scheduler import KilledWorker  # noqa: PLC0415 - an extra, and slow to import

        start = time.perf_counter()
        try:
            data = future.result(timeout=_FETCH_S)
        except TimeoutError:
            self._look()
            return None
        except KilledWorker as error:
            raise InputError(
                f"frames {shard[0]} to {shard[-1]}: expected workers that can gather them, found that each of "
                f"{error.allowed_failures + 1} was killed or crashed over them (out of memory?)"
            ) from None
        except InputError as error:
            raise InputError(str(error)) from None  # without the worker's traceback
        except RuntimeError as error:
            if "deserializ" not in str(error):
                raise
            raise InputError(
                f"--scheduler {self.scheduler}: expected the same program there as here, found one that does not "
                "understand its tasks"
            ) from None
        self.moved.fetched_s += time.perf_counter() - start
        return data

    def _unpacked(self, data: bytes, shard: Sequence[int]) -> Iterator[FrameStep]:
        start = time.perf_counter()
        try:
            steps = list(steps_in(data, shard))
        except ValueError as error:
            raise InputError(
                f"--scheduler {self.scheduler}: expected frames {shard[0]} to {shard[-1]} from a worker, found {error}"
            ) from error
        self.moved.unpacked_s += time.perf_counter() - start
        self.moved.received += len(data)
        self.moved.frames += len(shard)
        yield from steps


@contextmanager
def open_workers(scheduler: str, reopen: Callable[[], FrameSource]) -> Iterator[Workers]:
    """Start processes on this machine, or connect to a cluster; whatever was started or opened is closed again.

    Args:
        scheduler: ``local:N`` or the address of a Dask scheduler, ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
        reopen: opens the sequence on a worker; can be pickled and hashed, see `shards.reopening`.

    Raises:
        InputError: it is neither, the extra ``cluster`` is missing, nobody answers there, there are no workers, or one
            of them has another version of this package.
    """
    local = re.fullmatch(r"local:(\d{1,3})", scheduler)
    if local is not None and not 1 <= int(local[1]) <= MAX_LOCAL:
        raise InputError(f"--scheduler {scheduler}: expected 1 to {MAX_LOCAL} processes, found {int(local[1])}")
    if local is None:
        _check_address(scheduler)
    with needs_extra("cluster", "--scheduler"):
        import distributed  # noqa: F401, PLC0415 - an extra, and slow to import
    _silence()
    with ExitStack() as stack:
        address = scheduler if local is None else stack.enter_context(_local_cluster(int(local[1])))
        client = stack.enter_context(_connected(scheduler, address))
        check_versions(client)
        yield Workers(client, scheduler, reopen, _known=len(_threads(client)))


def _silence() -> None:
    """Silence Dask's loggers in this process; its faults are reported as our errors.

    asyncio's too: where Ctrl-C comes while Dask fetches a result, it prints a traceback of Dask's own ``AllExit``.
    """
    for name in (
        "distributed",
        "asyncio",
        *(name for name in logging.root.manager.loggerDict if name.startswith("distributed.")),
    ):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _on_worker(job: Job, indices: Sequence[int], T_map_camera: NDArray) -> bytes:
    """Gather a shard on a worker, whose address its errors name."""
    try:
        return gather_shard(job, indices, T_map_camera)
    except InputError as error:
        from distributed import get_worker  # noqa: PLC0415 - an extra, and slow to import

        raise InputError(f"worker {get_worker().address}: {error}") from None


def _check_address(scheduler: str) -> None:
    """Check that a scheduler listens there; Dask would retry for long, and forever with a silent server."""
    kind, host, port = _parts(scheduler)
    if kind not in ("tcp", "tls") or not host or not port:
        raise InputError(
            f"--scheduler {scheduler}: expected local:N (N processes of this machine) or the tcp://HOST:PORT of a Dask "
            "scheduler, found neither"
        )
    try:
        with socket.create_connection((host, port), timeout=_CONNECT_S) as connection:
            length = int.from_bytes(connection.recv(8, socket.MSG_WAITALL), "little") if kind == "tcp" else 1
    except OSError as error:
        reason = "one that does not answer" if isinstance(error, TimeoutError) else f"none ({error.strerror or error})"
        raise InputError(f"--scheduler {scheduler}: expected a Dask scheduler there, found {reason}") from None
    if not 0 < length < _MAX_GREETING:
        raise InputError(f"--scheduler {scheduler}: expected a Dask scheduler there, found another server")


def _parts(address: str) -> tuple[str, str, int]:
    """Return kind, host and port of an address; empty or 0 where missing."""
    try:
        parts = urlsplit(address)
        return parts.scheme, parts.hostname or "", parts.port or 0
    except ValueError:
        return "", "", 0


@contextmanager
def _local_cluster(processes: int) -> Iterator[str]:
    from distributed import LocalCluster  # noqa: PLC0415 - an extra, and slow to import

    with _no_interrupt_for_children():
        cluster = LocalCluster(
            n_workers=processes, processes=True, threads_per_worker=1, host="127.0.0.1",
            dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False}, silence_logs=logging.CRITICAL + 1,
        )  # fmt: skip
    with cluster:
        yield cluster.scheduler_address


@contextmanager
def _no_interrupt_for_children() -> Iterator[None]:
    """Block Ctrl-C for threads started here and the processes they start: this process ends them."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # starting it ends the block
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _connected(scheduler: str, address: str) -> Iterator["Client"]:
    from distributed import Client  # noqa: PLC0415 - an extra, and slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of other versions than ours, which do not matter
            client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--scheduler {scheduler}: expected a Dask scheduler there, found something else ({error})"
        ) from None
    try:
        client.wait_for_workers(1, timeout=_CONNECT_S)
        yield client
    except TimeoutError:
        raise InputError(
            f"--scheduler {scheduler}: expected at least one worker, found none within {_CONNECT_S:.0f} s"
        ) from None
    finally:
        client.close(timeout=_CONNECT_S)


def _threads(client: "Client") -> dict[str, int]:
    """Return {worker's address: number of its threads}."""
    return client.nthreads()  # pyright: ignore[reportReturnType] - a coroutine in asynchronous clients only


def check_versions(client: "Client") -> None:
    """Raise InputError unless the scheduler and all workers have this version of this package."""
    here = version("simaps-viz")
    found: Any = client.get_versions(packages=["simaps-viz"])
    everybody = {"the scheduler": found["scheduler"]}  # it unpacks the tasks, too
    everybody |= {f"worker {address}": about for address, about in sorted(found["workers"].items())}
    for who, about in everybody.items():
        there = about["packages"]["simaps-viz"]
        if there != here:
            raise InputError(f"{who}: expected simaps-viz {here} as here, found {there or 'none installed'}")
