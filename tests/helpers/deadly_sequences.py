"""Sequences that workers open again, and that do what must not stop a build. They travel to other processes by name."""

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from random_frames import IS_THING, LABELS, random_frames

from simaps_viz import open_sequence


class Deadly:
    """A sequence that is read as it is, but for one frame: reading it kills the process."""

    def __init__(self, sequence, frame, flag):
        self._sequence, self._frame, self._flag = sequence, frame, flag

    def __getattr__(self, name):
        return getattr(self._sequence, name)

    def __len__(self):
        return len(self._sequence)

    def read(self, index, *, color=False):
        if index == self._frame and not (self._flag and self._flag.exists()):
            if self._flag:
                self._flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return self._sequence.read(index, color=color)


@dataclass(frozen=True)
class KillsItsWorker:
    """Opens a sequence with a deadly frame; with a flag, a file, it kills only once."""

    path: str
    frame: int
    flag: str = ""

    def __call__(self) -> Any:
        flag = Path(self.flag) if self.flag else None
        return Deadly(open_sequence(Path(self.path)), self.frame, flag)


class Slow:
    """A sequence whose every frame takes its time."""

    def __init__(self, sequence, seconds):
        self._sequence, self._seconds = sequence, seconds

    def __getattr__(self, name):
        return getattr(self._sequence, name)

    def __len__(self):
        return len(self._sequence)

    def read(self, index, *, color=False):
        time.sleep(self._seconds)
        return self._sequence.read(index, color=color)


@dataclass(frozen=True)
class OpensSlow:
    path: str
    seconds: float

    def __call__(self) -> Any:
        return Slow(open_sequence(Path(self.path)), self.seconds)


class Random:
    """Random frames as a sequence, in memory."""

    def __init__(self, seed, frames):
        self._all = random_frames(seed, frames)
        self.name, self.path = "random", Path("random")
        self.frame_names = tuple(frame.name for frame, _, _ in self._all)
        self.poses = np.stack([T for _, _, T in self._all])
        self.T_map_world, self.labels, self.is_thing = np.eye(4), LABELS, IS_THING
        self.segmentation_source, self.simulated = "random", True

    def __len__(self):
        return len(self._all)

    def read(self, index, *, color=False):
        return self._all[index][0]

    def described(self):
        return b"random"

    def segmentation(self, index):
        return self._all[index][1]


@dataclass(frozen=True)
class OpensRandom:
    seed: int
    frames: int

    def __call__(self) -> Any:
        return Random(self.seed, self.frames)


class Held(Deadly):
    """A sequence whose one frame is not read before there is a flag, a file."""

    def read(self, index, *, color=False):
        while index == self._frame and not self._flag.exists():
            self._flag.with_suffix(".asked").touch()
            time.sleep(0.02)
        return self._sequence.read(index, color=color)


class OpensHeld(KillsItsWorker):
    def __call__(self) -> Any:
        return Held(open_sequence(Path(self.path)), self.frame, Path(self.flag))
