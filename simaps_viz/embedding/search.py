"""Find the objects of a map that free words describe, or refuse.

What the map's own classes and the tables of words know (synonyms, kinds, needs) is answered from them. For the rest,
an object's vector, with its class as a prior, is compared with the words and with what they compete with
(`stock_words.json`): the score is their share of a softmax whose scale the map was calibrated to.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from simaps_viz.appearance import Appearance, unit
from simaps_viz.colors.classes import plain
from simaps_viz.errors import CommandError, InputError
from simaps_viz.language.words import ACTIVITIES, Vocabulary
from simaps_viz.structures import Instance, SIMap

STOCK: Mapping[str, list[str]] = json.loads(
    resources.files("simaps_viz.embedding").joinpath("stock_words.json").read_text(encoding="utf-8")
)
MIN_SCORE = 0.35
"""An object whose score is lower is not what was asked for."""
MIN_MARGIN = 0.05
"""If the best object's best other word comes closer than this, the words do not fit it clearly."""
_CLASS_SHARE = 0.3
"""How much of an object's vector is that of its class (as in DualMap)."""
_USE_WORDS = ("something", "somewhere", "anything", "anywhere", "a place", "a thing", "place to", "thing to")
_MAX_WORDS = 300
_indices: WeakKeyDictionary[SIMap, "Index"] = WeakKeyDictionary()


@dataclass(frozen=True)
class Found:
    """An object that free words describe."""

    instance: Instance
    score: float
    """0 to 1: how much better the words fit than the words they compete with; 1 where a table knows them."""


def search(simap: SIMap, words: str, k: int = 5) -> tuple[Found, ...]:
    """Find the objects that free words describe ("something to read", "red mug"), the best first.

    Args:
        simap: the map; words that no table knows need one that `simaps describe` has described.
        words: a few words.
        k: how many at most.

    Raises:
        CommandError: nothing on the map fits clearly, or the words are in no table and the map is not described, or its
            embedding cannot be used here.
        InputError: the words are no text, empty or long, or k is below 1.
    """
    if not isinstance(words, str) or not words.strip() or len(words) > _MAX_WORDS:
        raise InputError(f"words: expected up to {_MAX_WORDS} characters, found {str(words)[:60]!r}")
    if k < 1:
        raise InputError(f"k: expected at least 1, found {k}")
    asked = " ".join(words.lower().split()).removeprefix("the ").removeprefix("a ").strip(" .?!")
    known = _by_table(simap, asked)
    if known:
        return tuple(Found(one, 1.0) for one in known[:k])
    look = simap.appearance
    if look is None or not look.described:
        raise CommandError(f'No object of this map is called "{asked}". Free words need simaps describe.')
    return _by_vectors(simap, look, asked, k)


def _by_table(simap: SIMap, asked: str) -> tuple[Instance, ...]:
    """Return the objects that classes, synonyms, kinds and needs name."""
    vocabulary = Vocabulary(simap.counts())
    parts = asked.split()
    use, length = vocabulary.activity(parts)
    names = [asked, use if length == len(parts) else "", ACTIVITIES.get(tuple(parts), "")]
    for name in filter(None, names):
        meaning = vocabulary.resolve(name)
        if meaning is not None:
            return tuple(one for label in meaning.labels for one in simap.of_class(label))
    return ()


def _by_vectors(simap: SIMap, look: Appearance, asked: str, k: int) -> tuple[Found, ...]:
    """Return the objects that look like the words, or raise CommandError."""
    query = _query_vector(look, asked)
    index = _indices.get(simap)
    if index is None:
        index = _indices[simap] = Index(simap, look)
    ranking = index.rank(query, uses=asked.startswith(_USE_WORDS))
    best = int(ranking.scores.argmax())
    rival, rival_score = ranking.rival(best)
    if ranking.scores[best] < MIN_SCORE:
        name = plain(simap.by_id(int(index.ids[best])).label)
        raise CommandError(
            f'Nothing on this map looks like "{asked}". The nearest is the {name}, which looks more like "{rival}".'
        )
    if ranking.scores[best] - rival_score < MIN_MARGIN:
        raise CommandError(f'What looks most like "{asked}" on this map looks as much like "{rival}".')
    order = np.argsort(-ranking.scores, kind="stable")[:k]
    return tuple(
        Found(simap.by_id(int(index.ids[i])), float(ranking.scores[i])) for i in order if ranking.scores[i] >= MIN_SCORE
    )


@dataclass(frozen=True, eq=False)
class Ranking:
    """How well a query fits each object of an index."""

    scores: NDArray
    """float32 [n], 0 to 1: the query's share of the softmax."""
    names: tuple[str, ...]
    """The words it competes with."""
    own: NDArray
    """float32 [n], exponential of the query."""
    others: NDArray
    """float32 [n, words], exponentials of these words."""
    compete: NDArray
    """float32 [words], 0 for words that mean the same as the query, else 1."""

    def rival(self, row: int) -> tuple[str, float]:
        """Return the competing word that fits an object best, and its share of the softmax."""
        if not self.names:
            return "", 0.0
        others = self.others[row] * self.compete
        best = int(others.argmax())
        return self.names[best], float(others[best]) / float(self.own[row] + others.sum())


class Index:
    """The described objects of a map, ready to be searched; making it costs more than a search."""

    def __init__(self, simap: SIMap, look: Appearance) -> None:
        self.ids, vectors = look.instance_vectors(simap)
        if not len(self.ids):
            raise CommandError("No object of this map is described.")
        words = unit(look.word_vectors.astype(np.float32))
        place = {word: i for i, word in enumerate(look.words)}
        # The class that a network or a person gave is worth more than the looks alone.
        label_of = {one.id: one.label for one in simap.instances}
        classes = [place.get(label_of[number], -1) for number in self.ids.tolist()]
        prior = np.where(np.array(classes)[:, None] >= 0, words[classes], vectors)
        self.vectors = unit((1.0 - _CLASS_SHARE) * vectors + _CLASS_SHARE * prior)
        self._scale = np.float32(look.model["scale"])
        uses = frozenset(STOCK["uses"])
        self._words, self._exponents = {}, {}
        logits = self._scale * (self.vectors @ words.T)
        self._top = logits.max(axis=1)
        for use in (False, True):
            columns = [i for i, word in enumerate(look.words) if (word in uses) == use]
            self._words[use] = tuple(look.words[i] for i in columns), words[columns]
            self._exponents[use] = np.exp(logits[:, columns] - self._top[:, None])

    def rank(self, query: NDArray, *, uses: bool = False) -> Ranking:
        """Score all objects against a query.

        Args:
            query: float32 [D], unit length.
            uses: it is a use ("something to read"), which competes with uses; otherwise a thing.
        """
        names, vectors = self._words[uses]
        exponents = self._exponents[uses]
        # Words that mean the same do not compete: those closer to the query than halfway from the usual word to it.
        near = vectors @ query
        usual = float(np.median(near)) if len(near) else 0.0
        compete = (near < (1.0 + usual) / 2.0).astype(np.float32)
        own = np.exp(np.minimum(self._scale * (self.vectors @ query) - self._top, 80.0))
        return Ranking(own / (own + exponents @ compete + 1e-30), names, own, exponents, compete)


def _query_vector(look: Appearance, asked: str) -> NDArray:
    """Embed the words: those that the map holds from its file, others by the network that it was described with."""
    if asked in look.words:
        return unit(look.word_vectors[look.words.index(asked)].astype(np.float32)[None])[0]
    from simaps_viz.embedding.towers import known_text  # noqa: PLC0415 - onnxruntime is slow to import

    try:
        tower = known_text(str(look.model.get("text_sha256")))
        query = None if tower is None else tower.words([asked])[0]
    except InputError as error:  # a command that needs it is refused, as where there is none
        raise CommandError(f'"{asked}" is in no table, and the embedding cannot be used: {error}') from error
    if query is None or query.shape != look.vectors.shape[1:]:
        raise CommandError(
            f'"{asked}" is in no table, and the embedding that described this map is not known here: set '
            f"SIMAPS_EMBEDDING to its folder."
        )
    return query
