"""What was worked out from large arrays, kept while those arrays live."""

import threading
import weakref
from collections.abc import Hashable, Sequence

from numpy.typing import NDArray

MOST = 24


class Remembered:
    """The last few results, found by the very arrays they came from; never keeps such an array alive."""

    def __init__(self) -> None:
        """Start empty."""
        self._lock = threading.Lock()
        self._kept: list[tuple[tuple[weakref.ref, ...], Hashable, NDArray]] = []

    def find(self, arrays: Sequence[NDArray], name: Hashable = None) -> NDArray | None:
        """Give what was kept for these arrays under that name."""
        with self._lock:
            for refs, kept_name, result in self._kept:
                same = len(refs) == len(arrays) and all(ref() is one for ref, one in zip(refs, arrays, strict=True))
                if same and kept_name == name:
                    return result
        return None

    def keep(self, arrays: Sequence[NDArray], name: Hashable, result: NDArray) -> None:
        """Keep a result; nobody may write into it."""
        with self._lock:
            alive = [entry for entry in self._kept if all(ref() is not None for ref in entry[0])]
            self._kept = [(tuple(weakref.ref(one) for one in arrays), name, result), *alive][:MOST]
