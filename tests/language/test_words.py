from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simaps_viz.colors.classes import COCO_THINGS, plain
from simaps_viz.language.words import SYNONYMS, Vocabulary, plural, singular, slips


def resolved(vocabulary: Vocabulary, spoken: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    meaning = vocabulary.resolve(spoken)
    return (meaning.labels, meaning.others) if meaning else ((), ())


@pytest.mark.parametrize("label", COCO_THINGS)
def test_plurals_go_back(label: str) -> None:
    assert singular(plural(label)) == label


@pytest.mark.parametrize("label", COCO_THINGS)
def test_every_class_is_found_by_its_name_and_plural(label: str) -> None:
    vocabulary = Vocabulary(COCO_THINGS)
    assert resolved(vocabulary, label)[0] == (label,)
    assert resolved(vocabulary, plural(label))[0] == (label,)
    assert vocabulary.match(label.split()) == len(label.split())


@pytest.mark.parametrize(
    ("spoken", "labels", "together", "others"),
    [
        ("sofa", ("couch",), ("couch",), ()),
        ("couch", ("sofa",), ("sofa",), ()),
        ("settee", ("sofa",), ("sofa",), ()),
        ("table", ("dining table",), ("dining table",), ()),
        ("tables", ("coffee table", "dining table"), ("dining table", "coffee table"), ()),
        ("table", ("dining table", "table"), ("table",), ("dining table",)),
        ("any table", ("dining table", "table", "desk"), ("table", "dining table"), ()),
        ("table", ("chair", "desk"), ("desk",), ()),
        ("telly", ("tv",), ("tv",), ()),
        ("television", ("tv_monitor",), ("tv_monitor",), ()),
        ("screen", ("tv", "monitor"), ("tv",), ("monitor",)),
        ("monitor", ("tv",), ("tv",), ()),
        ("fridge", ("refrigerator",), ("refrigerator",), ()),
        ("plants", ("potted plant",), ("potted plant",), ()),
        ("table", ("table-merged",), ("table-merged",), ()),
        ("people", ("person",), ("person",), ()),
        ("woman", ("person",), ("person",), ()),
        ("woman", ("man",), (), ()),
        ("piano", ("chair",), (), ()),
        ("dining tables", ("dining table",), ("dining table",), ()),
        ("Chair", ("chair",), ("chair",), ()),
        ("chair", ("office chair",), ("office chair",), ()),
        ("seat", ("chair", "couch", "tv"), ("chair", "couch"), ()),
        ("seats", ("stool",), ("stool",), ()),
        ("place to sleep", ("couch", "bed"), ("bed",), ("couch",)),
        ("counter", ("kitchen counter",), ("kitchen counter",), ()),
        ("dog", ("hot dog",), (), ()),
        ("bear", ("teddy bear",), ("teddy bear",), ()),
        ("bin", ("garbage can",), ("garbage can",), ()),
        ("object", ("chair", "tv"), ("chair", "tv"), ()),
    ],
)
def test_resolve(spoken: str, labels: tuple[str, ...], together: tuple[str, ...], others: tuple[str, ...]) -> None:
    assert resolved(Vocabulary(labels), spoken) == (together, others)


@pytest.mark.parametrize("label", COCO_THINGS)
def test_every_class_has_a_name_of_its_own_among_all(label: str) -> None:
    """No other word for a class names that class alone where a class is called so itself."""
    vocabulary = Vocabulary(COCO_THINGS)
    for word in (word for word, classes in SYNONYMS.items() if label in classes[:1] and word not in COCO_THINGS):
        assert label in (*resolved(vocabulary, word)[0], *resolved(vocabulary, word)[1]), word


@pytest.mark.parametrize(
    ("said", "kind", "length"),
    [
        ("somewhere to sit", "place to sit", 3),
        ("something to eat on please", "place to eat", 4),
        ("a place where i can lie down", "place to sleep", 7),
        ("anything to read", "place to read", 3),
        ("somewhere to wash my hands", "place to wash", 5),
        ("something to dance", "", 0),
        ("a chair", "", 0),
    ],
)
def test_what_is_done_somewhere(said: str, kind: str, length: int) -> None:
    assert Vocabulary(("chair",)).activity(said.split()) == (kind, length)


@pytest.mark.parametrize(
    ("said", "name"),
    [
        ("chiar", "chair"),
        ("cofee table", "coffee table"),
        ("chairz", "chair"),
        ("refridgerator", "refrigerator"),
        ("piano", ""),
        ("black", ""),
        ("char", "chair"),
        ("hair", ""),
        ("xyzzy", ""),
        ("ch", ""),
    ],
)
def test_misspelled_names(said: str, name: str) -> None:
    assert Vocabulary(("chair", "coffee table")).correct(said.split())[0] == name


@given(st.text("abcd", max_size=7), st.text("abcd", max_size=7))
def test_slips_is_a_distance(a: str, b: str) -> None:
    assert slips(a, b, 9) == slips(b, a, 9) == _slips(a, b)
    assert slips(a, a, 9) == 0
    assert min(slips(a, b, 1), 2) == min(slips(a, b, 9), 2)


@cache
def _slips(a: str, b: str) -> int:
    """The plain recursion of optimal string alignment."""
    if not a or not b:
        return len(a) + len(b)
    best = min(_slips(a[:-1], b) + 1, _slips(a, b[:-1]) + 1, _slips(a[:-1], b[:-1]) + (a[-1] != b[-1]))
    swapped = len(a) > 1 and len(b) > 1 and a[-1] == b[-2] and a[-2] == b[-1]
    return min(best, _slips(a[:-2], b[:-2]) + 1) if swapped else best


def test_suggest() -> None:
    assert Vocabulary(("chair", "couch")).suggest("chiar") == "chair"
    assert Vocabulary(("chair", "couch")).suggest("piano") is None


def test_plain() -> None:
    assert plain("TV_monitor") == "tv monitor"
    assert plain("table-merged") == "table"
