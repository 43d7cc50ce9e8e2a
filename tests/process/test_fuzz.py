"""A short, seeded run of the fuzzing targets, and whether the harness notices what must not happen.

A long run: ``apps/fuzz.py`` (docs/RELIABILITY.md).
"""

import contextlib
import signal
import warnings

import pytest
from attacks import fuzz_cases, fuzz_runner
from attacks.files import Watched
from attacks.fuzz_cases import Finding, Target, choices, limit_time, try_case
from attacks.fuzz_guided import Fed
from attacks.fuzz_mutators import mutator_of
from attacks.fuzz_runner import Tally, _batch, faults, quotas, table
from attacks.fuzz_targets import TARGETS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simaps_viz import open_sequence
from simaps_viz.datasets.calibration import pose_rows
from simaps_viz.datasets.clouds import read_pcd, read_ply
from simaps_viz.datasets.file_frames import read_array
from simaps_viz.datasets.images import read_color
from simaps_viz.datasets.manifest import read_json
from simaps_viz.errors import CommandError, InputError
from simaps_viz.mapping.file import load_map
from simaps_viz.mapping.history import MapHistory
from simaps_viz.mapping.mending import read_edits
from simaps_viz.mapping.steps import MAGIC
from simaps_viz.segmentation.class_names import read_class_names

SLOW = (
    "tum", "seven_scenes", "nerfstudio", "page messages", "recorded build", "rerun_rrd", "ros2_sqlite", "ros clouds",
    "network file", "posed frames, no up", "check, no up",
)  # fmt: skip
QUICK = [name for name in TARGETS if name not in SLOW]


@pytest.fixture(autouse=True)
def own_clock():
    before = signal.getsignal(signal.SIGPROF)
    limit_time()
    yield
    signal.signal(signal.SIGPROF, before)


@pytest.mark.parametrize("name", QUICK)
def test_damaged_and_hostile_input_is_taken_or_refused(tmp_path, name):
    target = TARGETS[name]
    count = 30 if target.guided else 6
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        case = target.prepare(tmp_path)
        found = [try_case(target, case, number, choices(name, 99, number)) for number in range(count)]
    assert [str(one) for one in found if isinstance(one, Finding)] == []
    assert found.count("refused") > 0


def judged(case) -> str | Finding:
    return try_case(Target("t", lambda folder: case), case, 7, choices("t", 0, 7))


def raising(error: BaseException):
    def case(r):
        raise error

    return case


def test_what_must_not_happen_is_noticed(monkeypatch):
    assert judged(lambda r: r.random()) == "accepted"
    assert judged(raising(CommandError("no"))) == "refused"
    broken = judged(raising(KeyError("x")))
    assert isinstance(broken, Finding) and (broken.kind, broken.case) == ("traceback", 7)
    two_lines = InputError("a")
    two_lines.args = ("a\nb",)
    told = judged(raising(two_lines))
    assert isinstance(told, Finding) and told.kind == "message"
    monkeypatch.setattr(fuzz_cases, "PATIENCE_S", 0.05)

    def forever(r):
        while True:
            with contextlib.suppress(Exception):
                r.random()

    stuck = judged(forever)
    assert isinstance(stuck, Finding) and stuck.kind == "hang"


def test_a_process_that_dies_is_a_finding():
    record = _batch("no such target", 0, 5, 10, 1.0)
    assert (record["cases"], record["refused"]) == (1, 0)
    assert record["findings"][0]["kind"] == "died" and record["findings"][0]["case"] == 5


def test_a_case_that_touches_a_file_is_a_finding(tmp_path, monkeypatch):
    def writes(*_):
        (tmp_path / "new").touch()
        return {"cases": 1, "accepted": 1, "refused": 0, "seconds": 0.0, "peak_bytes": 0, "findings": []}

    monkeypatch.setattr(fuzz_runner, "_batch", writes)
    found = fuzz_runner.fuzz({"manifest": 1}, Watched([tmp_path]))["manifest"].findings
    assert [(one["kind"], one["where"]) for one in found] == [("file", f"{tmp_path / 'new'} is new")]


def test_counts_add_up():
    one = Finding("manifest", 3, "traceback", "a.py:1 KeyError", "x")
    tally = Tally()
    for _ in range(2):
        tally.add({"cases": 10, "accepted": 4, "refused": 5, "seconds": 1.0, "peak_bytes": 5, "findings": [vars(one)]})
    assert (tally.cases, tally.accepted, tally.refused) == (20, 8, 10)
    assert len(faults([tally])) == 1
    assert "| manifest | 20 | 10 | 8 | 2 | 0 |" in table({"manifest": tally}) and "| all | 20 |" in table(
        {"manifest": tally}
    )
    assert sum(quotas(1_000_000, list(TARGETS)).values()) > 990_000
    assert min(quotas(1_000_000, list(TARGETS)).values()) > 500


def test_cases_come_back():
    data = b'{"a": [1, 2.5, "x"], "b": {"c": null}}'
    made = [mutator_of("a.json")(choices("t", 1, n), data) for n in range(50)]
    assert made == [mutator_of("a.json")(choices("t", 1, n), data) for n in range(50)] and len(set(made)) > 40


def test_bytes_make_choices():
    fed = Fed(b"\x07\x00\x00\x00" + bytes(20))
    assert fed.getrandbits(8) == 7 and fed.random() == 0.0
    assert Fed(b"").randrange(1000) == 0 and len(Fed(b"ab").randbytes(9)) == 9


READ = {
    "a.json": read_json, "a.npy": read_array, "a.txt": pose_rows, "a.ply": read_ply, "a.pcd": read_pcd,
    "a.png": read_color, "a.npz": load_map, "a.edits.json": read_edits, "a.steps": MapHistory.open,
    "a.sens": open_sequence, "a.labels.json": read_class_names,
}  # fmt: skip
STARTS = st.sampled_from(
    [b"", b"{", b"ply\n", b"\x93NUMPY\x01\x00", b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"PK\x03\x04", MAGIC]
)


@pytest.mark.parametrize("name", READ)
@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(start=STARTS, rest=st.binary(max_size=200))
def test_any_bytes_are_taken_or_refused(tmp_path, name, start, rest):
    path = tmp_path / name
    path.write_bytes(start + rest)
    with contextlib.suppress(InputError):
        READ[name](path)
    assert [p.name for p in tmp_path.iterdir()] == [name]


@given(st.text(alphabet=st.characters(codec=None), max_size=60))
def test_any_message_is_one_line_that_can_be_printed(text):
    told = str(InputError(text))
    assert told.isprintable() and str(InputError(told)) == told and told.encode().decode() == told
    assert not text.isprintable() or told == text
