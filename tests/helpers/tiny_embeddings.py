"""Tiny embeddings in the layouts that people have, whose vectors show exactly what the networks were given."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from tiny_onnx import INT32, INT64, node, write_graph
from tokenizers import Tokenizer, models, pre_tokenizers, processors

FLOAT = 1
SIDE = 6
"""Height and width of the pictures."""
DIMENSION = 3 * SIDE * SIDE
WORDS = ("a", "photo", "of", "red", "green", "chair", "floor", "Chair", "chair.", "a.")
CLIP = ("<|startoftext|>", "<|endoftext|>", "!")
SIGLIP = ("<pad>", "</s>")
GEMMA = ("<pad>", "<eos>", "<bos>")


def write_tokenizer(folder: Path, special: tuple[str, ...], **about: Any) -> dict[str, int]:
    """Write a tokenizer of whole words whose file asks for other padding and special tokens than the networks want."""
    vocabulary = {word: number for number, word in enumerate((*special, "<unk>", *WORDS))}
    tokenizer = Tokenizer(models.WordLevel(vocabulary, unk_token="<unk>"))
    tokenizer.pre_tokenizer = pre_tokenizers.WhitespaceSplit()
    tokenizer.post_processor = processors.TemplateProcessing(
        single=f"{special[-1]} $A {special[-1]}", special_tokens=[(special[-1], vocabulary[special[-1]])]
    )
    tokenizer.enable_padding(direction="left", pad_id=2, length=99)
    tokenizer.enable_truncation(max_length=3)
    folder.mkdir(parents=True, exist_ok=True)
    tokenizer.save(str(folder / "tokenizer.json"))
    (folder / "tokenizer_config.json").write_text(json.dumps(about))
    return vocabulary


def write_vision(
    path: Path,
    *,
    name: str = "pixel_values",
    output: str = "image_embeds",
    size: Any = "side",
    batch: Any = "batch",
    dimension: int = DIMENSION,
    hidden: str = "",
) -> Path:
    """Write a network whose embedding of a picture is the picture as it was prepared, row by row."""
    nodes = [node("Flatten", [name], output, axis=1)]
    outputs = {output: (batch, dimension)}
    if hidden:  # as SigLIP has it, before the embedding
        nodes.append(node("Identity", [name], hidden))
        outputs = {hidden: (batch, 3, "h", "w"), **outputs}
    return write_graph(path, nodes, {name: ((batch, 3, size, size), FLOAT)}, outputs, {})


def write_text(
    path: Path,
    *,
    name: str = "input_ids",
    output: str = "text_embeds",
    kind: int = INT64,
    length: Any = "n",
    tokens: int = 77,
    mask: bool = False,
    batch: Any = "batch",
    dimension: int = DIMENSION,
) -> Path:
    """Write a network whose embedding of a text is its ids, one a number; with a mask, ids where the mask is 1."""
    nodes = [node("Cast", [name], "numbers", to=FLOAT)]
    inputs = {name: ((batch, length), kind)}
    if mask:
        nodes += [node("Cast", ["attention_mask"], "kept", to=FLOAT), node("Mul", ["numbers", "kept"], "shown")]
        inputs["attention_mask"] = ((batch, length), kind)
    nodes.append(node("MatMul", ["shown" if mask else "numbers", "spread"], output))
    return write_graph(path, nodes, inputs, {output: (batch, dimension)}, {"spread": np.eye(tokens, dimension)})


def write_transformers(folder: Path, family: str = "clip", **given: Any) -> dict[str, int]:
    """Write a folder as transformers.js has it; returns the vocabulary."""
    special, about = {
        "clip": (CLIP, {"tokenizer_class": "CLIPTokenizer", "pad_token": "!"}),
        "siglip": (SIGLIP, {"tokenizer_class": "SiglipTokenizer", "pad_token": "</s>"}),
        "siglip2": (GEMMA, {"tokenizer_class": "GemmaTokenizer", "pad_token": "<pad>"}),
    }[family]
    pictures = {
        "clip": {
            "size": {"shortest_edge": SIDE},
            "crop_size": {"height": SIDE, "width": SIDE},
            "do_center_crop": True,
            "image_mean": [0.48145466, 0.4578275, 0.40821073],
            "image_std": [0.26862954, 0.26130258, 0.27577711],
        },
    }.get(family, {"size": {"height": SIDE, "width": SIDE}, "image_mean": [0.5] * 3, "image_std": [0.5] * 3})
    vocabulary = write_tokenizer(folder, special, **about)
    kind = "siglip" if family.startswith("siglip") else "clip"
    (folder / "config.json").write_text(json.dumps({"model_type": kind}))
    (folder / "preprocessor_config.json").write_text(json.dumps({**pictures, "resample": 3, **given}))
    tokens = 77 if family == "clip" else 64
    output = ("text_embeds", "image_embeds") if family == "clip" else ("pooler_output", "pooler_output")
    write_text(folder / "onnx" / "text_model.onnx", output=output[0], tokens=tokens)
    hidden = "" if family == "clip" else "last_hidden_state"
    write_vision(folder / "onnx" / "vision_model.onnx", output=output[1], hidden=hidden)
    return vocabulary


def write_immich(folder: Path, *, clean: str = "", **given: Any) -> dict[str, int]:
    """Write a folder as Immich has open_clip's networks; returns the vocabulary."""
    vocabulary = write_tokenizer(folder / "textual", CLIP, pad_token={"content": "<|endoftext|>"})
    text = {"context_length": 77, **({"tokenizer_kwargs": {"clean": clean}} if clean else {})}
    (folder / "config.json").write_text(json.dumps({"embed_dim": DIMENSION, "text_cfg": text}))
    (folder / "visual").mkdir()
    rule = {"size": [SIDE, SIDE], "interpolation": "bicubic", "resize_mode": "shortest", **given}
    (folder / "visual" / "preprocess_cfg.json").write_text(json.dumps(rule))
    write_text(folder / "textual" / "model.onnx", name="text", output="embedding", kind=INT32, length=77, batch=1)
    write_vision(folder / "visual" / "model.onnx", name="image", output="embedding", batch=1)
    return vocabulary


def write_colors(folder: Path) -> None:
    """Write an embedding that knows colours: a picture's vector is its mean colour, a word's the colour it names.

    "chair" has a direction of its own, "red" and "something" with it; other words have none.
    """
    meaning = {"red": (1, 0, 0, 0), "green": (0, 1, 0, 0), "blue": (0, 0, 1, 0), "chair": (0, 0, 0, 1),
               "something": (0.6, 0, 0, 0.1), "to": (0, 0, 0, 0), "sit": (0, 1, 0, 0)}  # fmt: skip
    vocabulary = {word: number for number, word in enumerate((*CLIP, "<unk>", *meaning, *(f"{w}." for w in meaning)))}
    table = np.zeros((len(vocabulary), 4))
    for word, vector in meaning.items():
        table[vocabulary[word]] = table[vocabulary[f"{word}."]] = vector
    tokenizer = Tokenizer(models.WordLevel(vocabulary, unk_token="<unk>"))
    tokenizer.pre_tokenizer = pre_tokenizers.WhitespaceSplit()
    folder.mkdir(parents=True)
    tokenizer.save(str(folder / "tokenizer.json"))
    rule = {"size": {"height": SIDE, "width": SIDE}, "do_center_crop": False, "do_normalize": False}
    (folder / "preprocessor_config.json").write_text(json.dumps(rule))
    gather = [
        node("Gather", ["table", "input_ids"], "each"),
        node("ReduceMean", ["each"], "text_embeds", axes=[1], keepdims=0),
    ]
    inputs = {"input_ids": (("b", "n"), INT64)}
    write_graph(folder / "onnx" / "text_model.onnx", gather, inputs, {"text_embeds": ("b", 4)}, {"table": table})
    mean = [
        node("ReduceMean", ["pixel_values"], "color", axes=[2, 3], keepdims=0),
        node("MatMul", ["color", "widen"], "image_embeds"),
    ]
    inputs = {"pixel_values": (("b", 3, "h", "w"), FLOAT)}
    constants = {"widen": np.eye(3, 4)}
    write_graph(folder / "onnx" / "vision_model.onnx", mean, inputs, {"image_embeds": ("b", 4)}, constants)
