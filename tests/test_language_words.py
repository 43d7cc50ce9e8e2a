import pytest

from simaps_viz.labels import COCO_THINGS
from simaps_viz.language.words import Vocabulary, plain, plural, singular


@pytest.mark.parametrize("label", COCO_THINGS)
def test_plurals_go_back(label: str) -> None:
    assert singular(plural(label)) == label


@pytest.mark.parametrize("label", COCO_THINGS)
def test_every_class_is_found_by_its_name_and_plural(label: str) -> None:
    vocabulary = Vocabulary(COCO_THINGS)
    assert vocabulary.resolve(label)[0] == label
    assert vocabulary.resolve(plural(label))[0] == label
    assert vocabulary.match(label.split()) == len(label.split())


@pytest.mark.parametrize(
    ("spoken", "labels", "expected"),
    [
        ("sofa", ("couch",), ("couch",)),
        ("couch", ("sofa",), ("sofa",)),
        ("table", ("dining table",), ("dining table",)),
        ("tables", ("coffee table", "dining table"), ("dining table", "coffee table")),
        ("table", ("dining table", "table"), ("table", "dining table")),
        ("telly", ("tv",), ("tv",)),
        ("television", ("tv_monitor",), ("tv_monitor",)),
        ("screen", ("tv", "monitor"), ("tv", "monitor")),
        ("monitor", ("tv",), ("tv",)),
        ("fridge", ("refrigerator",), ("refrigerator",)),
        ("plants", ("potted plant",), ("potted plant",)),
        ("table", ("table-merged",), ("table-merged",)),
        ("people", ("person",), ("person",)),
        ("piano", ("chair",), ()),
        ("dining tables", ("dining table",), ("dining table",)),
        ("Chair", ("chair",), ("chair",)),
    ],
)
def test_resolve(spoken: str, labels: tuple[str, ...], expected: tuple[str, ...]) -> None:
    assert Vocabulary(labels).resolve(spoken) == expected


def test_suggest() -> None:
    assert Vocabulary(("chair", "couch")).suggest("chiar") == "chair"
    assert Vocabulary(("chair", "couch")).suggest("piano") is None


def test_plain() -> None:
    assert plain("TV_monitor") == "tv monitor"
    assert plain("table-merged") == "table"
