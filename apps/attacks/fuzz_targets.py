"""All fuzzing targets by name."""

from attacks.fuzz_language import LANGUAGE_TARGETS
from attacks.fuzz_live import LIVE_TARGETS
from attacks.fuzz_maps import MAP_TARGETS
from attacks.fuzz_native import NATIVE_TARGETS
from attacks.fuzz_page import PAGE_TARGETS
from attacks.fuzz_readers import READER_TARGETS

TARGETS = {
    t.name: t
    for t in (
        *READER_TARGETS, *MAP_TARGETS, *LANGUAGE_TARGETS, *NATIVE_TARGETS, *PAGE_TARGETS, *LIVE_TARGETS,
    )
}  # fmt: skip
