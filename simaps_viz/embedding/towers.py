"""The user's own embedding of pictures and words: CLIP, MobileCLIP, SigLIP or SigLIP 2, exported to ONNX.

Three layouts are known: a folder of transformers.js (``onnx/text_model.onnx``, ``onnx/vision_model.onnx``), one of
open_clip as Immich has it (``textual/model.onnx``, ``visual/model.onnx``), and any pair of files. Which file is which
tower follows from its inputs. How pictures and words are prepared follows from the JSON files beside them: each family
wants something else, and what is prepared wrongly is embedded wrongly without an error.

Checked with tiny networks made in the tests; never tried with trained weights.
"""

import json
import os
import re
import string
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from simaps_viz.appearance import unit
from simaps_viz.build.pipeline import cache_folder, made_folder
from simaps_viz.datasets.manifest import read_json
from simaps_viz.errors import InputError, needs_extra
from simaps_viz.io.files import write_whole
from simaps_viz.io.limits import MAX_JSON_BYTES, check_file
from simaps_viz.segmentation.session import Port, Session

if TYPE_CHECKING:
    from tokenizers import Tokenizer

TEMPLATES = ("{word}", "a photo of {article}{word}.")
"""A word is embedded in each of these; its vector is their mean."""
_NO_ARTICLE = ("some", "any", "a ", "an ", "the ")
_CLIP_MEAN = (0.48145466, 0.4578275, 0.40821073)
_CLIP_STD = (0.26862954, 0.26130258, 0.27577711)
_HALF = (0.5, 0.5, 0.5)
_VARIANTS = ("", "fp16", "bf16", "q4f16", "int8", "uint8", "q8", "quantized", "q4", "bnb4")
"""Endings of file names, the most faithful first."""
_COARSE = frozenset(_VARIANTS[3:])
_BATCH = 8
_RESAMPLING = {0: Image.Resampling.NEAREST, 1: Image.Resampling.LANCZOS, 2: Image.Resampling.BILINEAR,
               3: Image.Resampling.BICUBIC}  # fmt: skip
_MAX_SIDE = 1024
_REGISTRY = "embeddings.json"


@dataclass(frozen=True)
class PictureRule:
    """How a picture is prepared for a vision tower."""

    size: tuple[int, int]
    """Height and width of the network's input."""
    squash: bool
    """Stretch to that size (SigLIP); otherwise scale the shortest side to it and cut out the middle (CLIP)."""
    shortest: int
    """Pixels that the shortest side is scaled to, unless squashed."""
    resample: int
    """As in PIL: 2 bilinear, 3 bicubic."""
    mean: tuple[float, ...]
    std: tuple[float, ...]

    def prepare(self, picture: NDArray) -> NDArray:
        """Return a picture, uint8 [H, W, 3] RGB, as float32 [3, height, width]."""
        rows, cols = self.size
        image = Image.fromarray(picture)
        if self.squash:
            image = image.resize((cols, rows), _RESAMPLING[self.resample])
        else:
            # As transformers do: the longer side is cut off to whole pixels, the middle rounded down.
            scale = self.shortest / min(image.size)
            width, height = (max(int(n * scale + 1e-6), 1) for n in image.size)
            image = image.resize((width, height), _RESAMPLING[self.resample])
            left, top = (width - cols) // 2, (height - rows) // 2
            image = image.crop((left, top, left + cols, top + rows))
        values = np.asarray(image, np.float32) / 255.0
        return ((values - np.array(self.mean, np.float32)) / np.array(self.std, np.float32)).transpose(2, 0, 1)


@dataclass(frozen=True)
class TextRule:
    """How words become token ids."""

    length: int
    """Every text is padded or cut to so many tokens."""
    pad: int
    """Id of the padding."""
    start: int | None
    """Id that every text has to begin with."""
    end: int | None
    """Id that every text has to end with, also when it is cut."""
    lower: bool
    plain: bool
    """Take punctuation away."""

    def clean(self, text: str) -> str:
        """Return a text as the network was trained to see it."""
        text = text.lower() if self.lower else text
        text = text.translate(str.maketrans("", "", string.punctuation)) if self.plain else text
        return " ".join(text.split())

    def ids(self, tokenizer: "Tokenizer", text: str) -> tuple[list[int], list[int]]:
        """Return ids and attention mask of a text, ``length`` each."""
        found = tokenizer.encode(self.clean(text), add_special_tokens=False).ids
        begin = [] if self.start is None else [self.start]
        finish = [] if self.end is None else [self.end]
        kept = [*begin, *found[: self.length - len(begin) - len(finish)], *finish]
        missing = self.length - len(kept)
        return kept + [self.pad] * missing, [1] * len(kept) + [0] * missing


class TextTower:
    """The network that embeds words."""

    def __init__(self, session: Session, root: Path) -> None:
        """Take an opened network; ``root`` is the folder that its JSON files are looked for in."""
        with needs_extra("embedding", "describing maps in free words"):
            from tokenizers import Tokenizer  # noqa: PLC0415 - optional
        self.session = session
        self.ids, self.mask = _text_inputs(session)
        self.output = _embedding_output(session)
        folders = _folders(session.path, root)
        path = _beside(folders, "tokenizer.json")
        if path is None:
            raise InputError(f"{session.path}: expected its tokenizer.json beside it, found none")
        check_file(path, MAX_JSON_BYTES, "a tokenizer")
        try:
            self.tokenizer = Tokenizer.from_file(str(path))
        except Exception as error:  # the library raises bare Exceptions
            raise InputError(f"{path}: expected a tokenizer, found: {str(error)[:200]}") from None
        self.tokenizer.no_padding()
        self.tokenizer.no_truncation()
        self.rule = text_rule(self.tokenizer, folders, self.ids, session.path)

    def embed(self, texts: Sequence[str]) -> NDArray:
        """Embed texts as they are; float32 [n, D], unit length."""
        rows = [self.rule.ids(self.tokenizer, text) for text in texts]
        tensors = {self.ids.name: np.array([ids for ids, _ in rows], self.ids.dtype)}
        if self.mask is not None:
            tensors[self.mask.name] = np.array([mask for _, mask in rows], self.mask.dtype)
        return _run(self.session, tensors, self.output, batch=self.ids.shape[0])

    def words(self, words: Sequence[str]) -> NDArray:
        """Embed words, each in all `TEMPLATES`; float32 [n, D], unit length."""
        articles = ["" if word.startswith(_NO_ARTICLE) else "a " for word in words]
        pairs = list(zip(words, articles, strict=True))
        parts = [self.embed([one.format(word=word, article=article) for word, article in pairs]) for one in TEMPLATES]
        return unit(np.mean(parts, axis=0))


class VisionTower:
    """The network that embeds pictures."""

    def __init__(self, session: Session, root: Path) -> None:
        """Take an opened network; ``root`` is the folder that its JSON files are looked for in."""
        self.session = session
        self.image = _image_input(session)
        self.output = _embedding_output(session)
        self.rule = picture_rule(_folders(session.path, root), self.image, session.path)

    @property
    def grey(self) -> NDArray:
        """The colour that becomes about 0, uint8 [3]."""
        return np.round(255.0 * np.array(self.rule.mean if any(self.rule.mean) else _HALF)).astype(np.uint8)

    def embed(self, pictures: Sequence[NDArray]) -> NDArray:
        """Embed pictures, uint8 [H, W, 3] RGB of any size; float32 [n, D], unit length."""
        tensor = np.stack([self.rule.prepare(picture) for picture in pictures]).astype(self.image.dtype)
        return _run(self.session, {self.image.name: tensor}, self.output, batch=self.image.shape[0])


@dataclass(frozen=True, eq=False)
class Embedding:
    """Both towers of an embedding."""

    text: TextTower
    vision: VisionTower
    dimension: int
    notes: tuple[str, ...] = ()
    """What a person should know of it, in words."""


def open_embedding(*paths: Path) -> Embedding:
    """Open both towers of an embedding, from a folder or the two files.

    Raises:
        InputError: there are no two networks that fit together, or what they need is not beside them.
    """
    text, vision = open_text(*paths), open_vision(*paths)
    sizes = text.embed(["a"]).shape[1], vision.embed([np.zeros((8, 8, 3), np.uint8)]).shape[1]
    if sizes[0] != sizes[1]:
        raise InputError(
            f"{vision.session.path}: expected pictures and words of one length, found {sizes[1]} numbers for pictures "
            f"and {sizes[0]} for words ({text.session.path.name}): the two files are not of one network"
        )
    notes = []
    if _variant(vision.session.path) in _COARSE:
        notes.append(
            f"{vision.session.path.name}: a vision network of 8 bits or less sees next to nothing; take one of 16 or 32"
        )
    return Embedding(text, vision, sizes[0], tuple(notes))


def open_text(*paths: Path) -> TextTower:
    """Open the tower of words in a folder, or among some files; see `open_embedding`.

    A file of 16 bits that onnxruntime cannot open is tried again without its optimisations, which trip over some.
    """
    return TextTower(_find(paths, "text"), _root(paths))


def open_vision(*paths: Path) -> VisionTower:
    """Open the tower of pictures in a folder, or among some files; see `open_embedding`."""
    return VisionTower(_find(paths, "vision"), _root(paths))


def _find(paths: Sequence[Path], wanted: str) -> Session:
    """Open the best file that is the wanted tower; names decide only the order, inputs what it is."""
    other = "vision" if wanted == "text" else "text"
    files = [file for file in _files(paths) if _hint(file) != other]
    faults: list[InputError] = []
    joint = None
    for file in sorted(files, key=lambda file: (_hint(file) != wanted, _VARIANTS.index(_variant(file)), str(file))):
        for optimize in (True, False) if wanted == "text" else (True,):
            try:
                session = Session(file, optimize=optimize)
            except InputError as error:
                faults.append(error)
                continue
            kind = _kind(session)
            if kind == wanted:
                return session
            joint = file if kind == "both" else joint
            break
    if joint is not None:
        raise InputError(f"{joint}: expected words and pictures in a file each, found one that takes both at once")
    if faults:
        raise faults[0]
    names = ", ".join(str(path) for path in paths)
    what = "whole numbers [batch, tokens]" if wanted == "text" else "a picture [batch, 3, height, width]"
    raise InputError(f"{names}: expected a {wanted} network (.onnx) that takes {what}, found none")


def _files(paths: Sequence[Path]) -> list[Path]:
    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            found += [file for depth in ("*.onnx", "*/*.onnx", "*/*/*.onnx") for file in path.glob(depth)]
        elif path.is_file():
            found.append(path)
        else:
            raise InputError(f"{path}: expected a folder with an embedding, or its network (.onnx), found nothing")
    return found


def _root(paths: Sequence[Path]) -> Path:
    """Return the folder of the layout: where a file lies in a folder for networks or for a tower, the one above."""
    first = paths[0]
    if first.is_dir():
        return first
    return first.parent.parent if first.parent.name == "onnx" or _hint(first.parent / "x") else first.parent


def _hint(file: Path) -> str:
    """Return the tower that a file's name, or its folder's, speaks of; "" for neither."""
    for name in (file.stem.lower(), file.parent.name.lower()):
        if re.search("text", name):
            return "text"
        if re.search("vision|visual|image", name):
            return "vision"
    return ""


def _variant(file: Path) -> str:
    ending = file.stem.lower().rpartition("_")[2]
    return ending if ending in _VARIANTS else ""


def _kind(session: Session) -> str:
    ids = any(np.dtype(port.dtype).kind == "i" and len(port.shape) == 2 for port in session.inputs if port.dtype)
    picture = any(np.dtype(port.dtype).kind == "f" and len(port.shape) == 4 for port in session.inputs if port.dtype)
    return "both" if ids and picture else "text" if ids else "vision" if picture else ""


def _text_inputs(session: Session) -> tuple[Port, Port | None]:
    """Return the inputs for ids and attention mask."""
    mask = next((port for port in session.inputs if "mask" in port.name), None)
    ids = [port for port in session.inputs if port is not mask]
    if len(ids) != 1:
        raise InputError(
            f"{session.path}: expected inputs for token ids and an attention mask, found "
            f"{', '.join(map(str, session.inputs))}"
        )
    return ids[0], mask


def _image_input(session: Session) -> Port:
    port = session.inputs[0]
    if len(session.inputs) != 1 or len(port.shape) != 4 or port.shape[1] not in (3, None):
        raise InputError(
            f"{session.path}: expected one picture [batch, 3, height, width], found "
            f"{', '.join(map(str, session.inputs))}"
        )
    return port


def _embedding_output(session: Session) -> str:
    """Return the output with an embedding a row: that called ``*_embeds`` or ``pooler_output``, else one of rank 2."""
    names = [port.name for port in session.outputs]
    found = [name for name in names if name.endswith("_embeds")] + [name for name in names if name == "pooler_output"]
    found += [port.name for port in session.outputs if len(port.shape) == 2]
    if not found:
        outputs = ", ".join(map(str, session.outputs))
        raise InputError(f"{session.path}: expected an output [batch, numbers] with the embedding, found {outputs}")
    return found[0]


def _run(session: Session, tensors: Mapping[str, NDArray], output: str, *, batch: int | None) -> NDArray:
    """Run a network over rows of its tensors; float32 [n, D], unit length."""
    count = len(next(iter(tensors.values())))
    rows = []
    for first in range(0, count, batch or _BATCH):
        part = {name: tensor[first : first + (batch or _BATCH)] for name, tensor in tensors.items()}
        missing = (batch or 0) - len(next(iter(part.values())))
        if missing > 0:  # a file that only takes full batches
            part = {name: np.concatenate([rows_, np.repeat(rows_[-1:], missing, 0)]) for name, rows_ in part.items()}
        rows.append(session.run(part, [output])[0])
    found = np.concatenate(rows)[:count].astype(np.float32)
    if found.ndim != 2 or not np.isfinite(found).all():
        raise InputError(f"{session.path}: expected finite embeddings [n, D], found {list(found.shape)}")
    return unit(found)


def _folders(file: Path, root: Path) -> list[Path]:
    """Return where the JSON files of a tower may be: beside it, above it up to the root, and beside the other one."""
    above = [file.parent, *(one for one in file.parents if one == root or root in one.parents)]
    return list(dict.fromkeys([*above, root]))


def _beside(folders: Iterable[Path], name: str) -> Path | None:
    return next((folder / name for folder in folders if (folder / name).is_file()), None)


def _settings(folders: Iterable[Path], name: str) -> dict[str, Any]:
    path = _beside(folders, name)
    if path is None:
        return {}
    found = read_json(path)
    return found if isinstance(found, dict) else {}


def picture_rule(folders: Sequence[Path], port: Port, file: Path) -> PictureRule:
    """Return how pictures are prepared, as the JSON files say; else as the family that the names speak of does.

    Raises:
        InputError: what they say makes no sense.
    """
    family = _family(folders, file)
    try:
        if given := _settings(folders, "preprocess_cfg.json"):
            rule = _open_clip_rule(given)
        elif given := _settings(folders, "preprocessor_config.json"):
            rule = _transformers_rule(given, family)
        elif family == "clip":
            rule = PictureRule((224, 224), False, 224, 3, _CLIP_MEAN, _CLIP_STD)
        elif family == "mobileclip":
            rule = PictureRule((256, 256), False, 256, 2, (0.0,) * 3, (1.0,) * 3)
        else:
            rule = PictureRule((224, 224), True, 224, 3, _HALF, _HALF)
        # A file that takes one size only decides.
        rows, cols = (port.shape[2] or rule.size[0]), (port.shape[3] or rule.size[1])
        fine = 1 <= rows <= _MAX_SIDE and 1 <= cols <= _MAX_SIDE and rule.resample in _RESAMPLING
        fine = fine and len(rule.mean) == len(rule.std) == 3 and all(std > 0 for std in rule.std)
        if not fine:
            raise ValueError("sizes, mean or std")
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"{file}: expected how its pictures are prepared, found: {error!r}"[:300]) from None
    fixed = port.shape[2] is not None and (rows, cols) != rule.size
    shortest = min(rows, cols) if fixed else max(rule.shortest, 1)
    return PictureRule((rows, cols), rule.squash, max(shortest, min(rows, cols)), rule.resample, rule.mean, rule.std)


def _transformers_rule(given: Mapping[str, Any], family: str) -> PictureRule:
    """Read ``preprocessor_config.json``."""
    size, crop = given.get("size", 224), given.get("crop_size")
    cuts = bool(given.get("do_center_crop", family in ("clip", "mobileclip")))
    squash = isinstance(size, Mapping) and "height" in size and not cuts
    shortest = int(size.get("shortest_edge") or size["height"]) if isinstance(size, Mapping) else int(size)
    target = crop if crop is not None and cuts else size
    if isinstance(target, Mapping) and "height" in target:
        rows, cols = int(target["height"]), int(target["width"])
    else:
        rows = cols = shortest if isinstance(target, Mapping) else int(target)
    normalize = bool(given.get("do_normalize", True))
    usual = (_CLIP_MEAN, _CLIP_STD) if family == "clip" else (_HALF, _HALF)
    mean = tuple(map(float, given.get("image_mean") or usual[0])) if normalize else (0.0,) * 3
    std = tuple(map(float, given.get("image_std") or usual[1])) if normalize else (1.0,) * 3
    return PictureRule((rows, cols), squash or not cuts, shortest, int(given.get("resample", 3)), mean, std)


def _open_clip_rule(given: Mapping[str, Any]) -> PictureRule:
    """Read ``preprocess_cfg.json``."""
    size = given.get("size", 224)
    rows, cols = map(int, size) if isinstance(size, Sequence) else (int(size), int(size))
    resample = {"bicubic": 3, "bilinear": 2, "nearest": 0}[given.get("interpolation", "bicubic")]
    squash = {"shortest": False, "squash": True}[given.get("resize_mode", "shortest")]
    mean, std = given.get("mean") or _CLIP_MEAN, given.get("std") or _CLIP_STD
    return PictureRule((rows, cols), squash, min(rows, cols), resample, tuple(map(float, mean)), tuple(map(float, std)))


def text_rule(tokenizer: "Tokenizer", folders: Sequence[Path], port: Port, file: Path) -> TextRule:
    """Return how texts are prepared: as the family of the network does, with the lengths and tokens of its files."""
    family = _family(folders, file)
    config, about = _settings(folders, "config.json"), _settings(folders, "tokenizer_config.json")
    text = _mapping(config.get("text_cfg")) or _mapping(config.get("text_config"))
    length = port.shape[1] or text.get("context_length") or text.get("max_position_embeddings")
    clean = _mapping(text.get("tokenizer_kwargs")).get("clean") == "canonicalize"

    def token(*names: str | None) -> int | None:
        known = (tokenizer.token_to_id(name) for name in names if name)
        return next((number for number in known if number is not None), None)

    pad = token(_content(about.get("pad_token")))
    if family == "siglip2":  # Gemma's tokenizer: no start, padded with 0 to 64, where the last token is pooled
        start, end, pad, usual, lower = None, token("<eos>"), 0, 64, True
    elif family == "siglip":  # padding with 0 in place of </s> moves the embedding far away
        end = token(_content(about.get("eos_token")), "</s>")
        start, pad, usual, clean, lower = None, end if end is not None else 1, 64, True, True
    else:
        start = token(_content(about.get("bos_token")), "<|startoftext|>", "<start_of_text>", "<s>")
        end = token(_content(about.get("eos_token")), "<|endoftext|>", "<end_of_text>", "</s>")
        lower, usual = clean, 77
    if not isinstance(length, int) or not 4 <= length <= 4096:
        length = usual
    return TextRule(int(length), pad or 0, start, end, lower, clean)


def _family(folders: Sequence[Path], file: Path) -> str:
    """Return "siglip2", "siglip", "mobileclip" or "clip", from the JSON files, else from names."""
    config, about = _settings(folders, "config.json"), _settings(folders, "tokenizer_config.json")
    kind, words = str(config.get("model_type", "")).lower(), str(about.get("tokenizer_class", "")).lower()
    names = " ".join([str(config.get("_name_or_path", "")), *file.parts[-4:]]).lower().replace("-", "")
    if kind == "siglip2" or words.startswith("gemma") or "siglip2" in names:
        return "siglip2"
    if "siglip" in kind + words or words.startswith("t5") or (not kind and "siglip" in names):
        return "siglip"
    pictures = _settings(folders, "preprocessor_config.json")
    return "mobileclip" if "mobileclip" in names or pictures.get("do_normalize") is False else "clip"


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _content(token: Any) -> str | None:
    """Return a special token, which a file writes as text or as an object."""
    found = token.get("content") if isinstance(token, Mapping) else token
    return found if isinstance(found, str) else None


def known_text(digest: str) -> TextTower | None:
    """Return the network of words with that SHA-256: that of ``SIMAPS_EMBEDDING``, or the one remembered here.

    Raises:
        InputError: another network is there now, or it cannot be opened.
    """
    given = os.environ.get("SIMAPS_EMBEDDING")
    path = Path(given) if given else _remembered().get(digest)
    if path is None or not path.exists():
        return None
    tower = _opened(path)
    if tower.session.digest != digest:
        raise InputError(f"{tower.session.path}: expected the network that the map was described with, found another")
    return tower


def remember(tower: TextTower) -> None:
    """Keep in the cache where a network of words lies: a map says only which one it was described with.

    Raises:
        InputError: the cache cannot be written.
    """
    known = {digest: str(path) for digest, path in _remembered().items()}
    known[tower.session.digest] = str(tower.session.path.resolve())
    file = made_folder(cache_folder()) / _REGISTRY
    write_whole(file, json.dumps(known, indent=1).encode(), "where embeddings lie", durable=False)


_opened = lru_cache(maxsize=2)(open_text)


def _remembered() -> dict[str, Path]:
    try:
        found = read_json(cache_folder() / _REGISTRY)
    except InputError:
        return {}
    return {str(digest): Path(path) for digest, path in found.items()} if isinstance(found, dict) else {}
