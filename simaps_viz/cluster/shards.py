"""A shard of a build: some frames of a sequence, gathered wherever the sequence can be opened, as steps in bytes."""

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from numpy.typing import NDArray

from simaps_viz.datasets.joined import JoinedFrames, join
from simaps_viz.datasets.posed_frames import open_sequence
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.limits import MAX_STEP_BYTES
from simaps_viz.mapping import so_far
from simaps_viz.mapping.config import BuildConfig
from simaps_viz.mapping.steps import FrameStep, pack_step, squeeze, unpack_step, unsqueeze
from simaps_viz.pipeline import content_of
from simaps_viz.segmentation.sequences import masks_from

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
        return join(opened) if self.joined else opened[0]

    def _open(self, path: Path, source: str) -> FrameSource:
        sequence = open_sequence(path, whole=False)
        if source == sequence.segmentation_source:
            return sequence
        masked = masks_from(sequence, source, Path(self.masks))
        if masked is None:
            raise InputError(f"{self.masks}: expected the masks of {source} for {path}, found none")
        return masked


def reopening(sequence: FrameSource, masks: Path) -> Reopen:
    """Say how a sequence is opened again.

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
    """What the sequence says of itself where the build was started."""
    version: str
    """Of this package, there."""
    config: BuildConfig
    labels: tuple[str, ...]
    is_thing: tuple[bool, ...]


def job_of(sequence: FrameSource, config: BuildConfig, reopen: Callable[[], FrameSource]) -> Job:
    """Say what a build's shards have in common."""
    return Job(reopen, content_of(sequence), version("simaps-viz"), config, sequence.labels, sequence.is_thing)


def gather_shard(job: Job, indices: Sequence[int], T_map_camera: NDArray) -> bytes:
    """Gather frames, ascending, and give all that they add to a map; frames that cannot be read are told as such.

    Args:
        job: of which build.
        indices: of the frames.
        T_map_camera: float64 [indices, 4, 4], as the one who asks has computed them: the last bit of a product of
            matrices depends on the machine.

    Raises:
        InputError: the sequence is not here, is another one, or cannot be mapped.
    """
    sequence = _opened(job.reopen, job.content, job.version)
    accumulator = so_far.empty_accumulator_of(job.labels, job.is_thing, job.config, links=False, steps=True)
    packed = []
    for index, pose in zip(indices, T_map_camera, strict=True):
        try:
            frame, segmentation = sequence.read(index), sequence.segmentation(index)
        except InputError as error:
            accumulator.skip_frame(index, sequence.frame_names[index], pose, str(error))
        else:
            accumulator.add_frame(frame, segmentation, pose)
        assert accumulator.step is not None  # steps were asked for
        packed.append(_sealed(accumulator.step, links=job.config.method == "paper"))
    return b"".join(packed)


def steps_in(data: bytes, indices: Sequence[int]) -> Iterator[FrameStep]:
    """Read what `gather_shard` gave for these frames.

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
            step = unpack_step(unsqueeze(content, most=MAX_STEP_BYTES))
        except (KeyError, TypeError, struct.error) as error:
            raise ValueError(f"no frame's step ({type(error).__name__})") from error
        if step.seen.index != index:
            raise ValueError(f"frame {step.seen.index} in place of {index}")
        at += length
        yield step


def _sealed(step: FrameStep, *, links: bool) -> bytes:
    content = squeeze(pack_step(step if links else replace(step, links=None)))
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
