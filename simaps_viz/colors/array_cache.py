"""A cache of what was computed from arrays, found by the identity of those arrays."""

import threading
import weakref
from collections.abc import Callable, Hashable, Sequence

from numpy.typing import NDArray

MAX_RESULTS = 24


class ArrayCache:
    """The last results of computations on arrays. It keeps none of those arrays alive."""

    def __init__(self) -> None:
        """Start empty."""
        self._lock = threading.RLock()
        self._kept: list[tuple[tuple[weakref.ref, ...], Hashable, NDArray]] = []

    def get(self, arrays: Sequence[NDArray], name: Hashable, compute: Callable[[], NDArray]) -> NDArray:
        """Return the result that these very arrays have under a name, computed if there is none yet.

        Only one thread computes at a time, so that several pages that want the same wait for the first. The result
        is shared: nobody may write into it.
        """
        with self._lock:
            for refs, kept_name, result in self._kept:
                same = len(refs) == len(arrays) and all(ref() is one for ref, one in zip(refs, arrays, strict=True))
                if same and kept_name == name:
                    return result
            result = compute()
            alive = [entry for entry in self._kept if all(ref() is not None for ref in entry[0])]
            self._kept = [(tuple(weakref.ref(one) for one in arrays), name, result), *alive][:MAX_RESULTS]
            return result
