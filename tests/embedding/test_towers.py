"""Embeddings people bring: the three layouts, and every way to prepare words or pictures wrongly without an error."""

import json
import shutil
import sys

import numpy as np
import pytest
from PIL import Image
from tiny_embeddings import (
    CLIP,
    DIMENSION,
    SIDE,
    write_immich,
    write_text,
    write_tokenizer,
    write_transformers,
    write_vision,
)
from tiny_onnx import INT64, node, write_graph

from simaps_viz.embedding import towers
from simaps_viz.embedding.towers import open_embedding, open_text, open_vision
from simaps_viz.errors import InputError

PICTURE = np.random.default_rng(0).integers(0, 256, (9, 15, 3)).astype(np.uint8)
CLIP_MEAN, CLIP_STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)


def expect_ids(tower, text, expected):
    expected = np.array([*expected, *[0] * (DIMENSION - len(expected))], float)
    np.testing.assert_allclose(tower.embed([text])[0], expected / np.linalg.norm(expected), atol=1e-6)


def expect_picture(tower, pixels):
    expected = pixels.transpose(2, 0, 1).reshape(-1)
    np.testing.assert_allclose(tower.embed([PICTURE])[0], expected / np.linalg.norm(expected), atol=1e-5)


def scaled(width, height, resample=Image.Resampling.BICUBIC):
    return np.asarray(Image.fromarray(PICTURE).resize((width, height), resample), np.float64) / 255.0


def middle(pixels):
    top, left = (pixels.shape[0] - SIDE) // 2, (pixels.shape[1] - SIDE) // 2
    return pixels[top : top + SIDE, left : left + SIDE]


def test_transformers_clip(tmp_path):
    known = write_transformers(tmp_path, "clip")
    found = open_embedding(tmp_path)
    start, end, pad = (known[name] for name in CLIP)
    assert found.dimension == DIMENSION and found.notes == ()
    expect_ids(found.text, "a red chair", [start, known["a"], known["red"], known["chair"], end, *[pad] * 72])
    expect_picture(found.vision, (middle(scaled(10, 6)) - CLIP_MEAN) / CLIP_STD)
    # A text of more than 77 tokens keeps its end.
    expect_ids(found.text, "red " * 100, [start, *[known["red"]] * 75, end])


def test_mobileclip_is_not_normalised(tmp_path):
    write_transformers(tmp_path, "clip", do_normalize=False, resample=2)
    expect_picture(open_vision(tmp_path), middle(scaled(10, 6, Image.Resampling.BILINEAR)))


def test_siglip_squashes_and_pads_with_its_end(tmp_path):
    known = write_transformers(tmp_path, "siglip")
    found = open_embedding(tmp_path)
    assert found.vision.output == "pooler_output"
    end = known["</s>"]
    assert end == 1
    expect_ids(found.text, "A red, CHAIR!", [known["a"], known["red"], known["chair"], end, *[end] * 60])
    expect_picture(found.vision, (scaled(SIDE, SIDE) - 0.5) / 0.5)


def test_siglip_2_is_lower_case_and_padded_with_0_to_64(tmp_path):
    known = write_transformers(tmp_path, "siglip2")
    text = open_text(tmp_path)
    expect_ids(text, "A Red chair.", [known["a"], known["red"], known["chair."], known["<eos>"], *[0] * 60])
    assert text.rule.length == 64 and text.rule.start is None


def test_immich_takes_whole_words_of_32_bits_one_at_a_time(tmp_path):
    known = write_immich(tmp_path)
    found = open_embedding(tmp_path)
    start, end, _ = (known[name] for name in CLIP)
    expect_ids(found.text, "red Chair", [start, known["red"], known["Chair"], end, *[end] * 73])
    expect_picture(found.vision, (middle(scaled(10, 6)) - CLIP_MEAN) / CLIP_STD)
    several = found.text.embed(["red", "green", "chair"])
    np.testing.assert_array_equal(several[1], found.text.embed(["green"])[0])


def test_immich_says_how_words_are_cleaned_and_pictures_squashed(tmp_path):
    known = write_immich(tmp_path, clean="canonicalize", resize_mode="squash", mean=[0.1] * 3, std=[0.2] * 3)
    start, end, _ = (known[name] for name in CLIP)
    expect_ids(open_text(tmp_path), "Red, Chair.", [start, known["red"], known["chair"], end, *[end] * 73])
    expect_picture(open_vision(tmp_path), (scaled(SIDE, SIDE) - 0.1) / 0.2)


def test_a_pair_of_files(tmp_path):
    """As usls has them, and as two files of any name; without settings CLIP's are taken."""
    known = write_tokenizer(tmp_path, CLIP)
    a = write_text(tmp_path / "vit-b32-textual.onnx", name="input", output="output", length=77)
    b = write_vision(tmp_path / "vit-b32-visual.onnx", name="input", output="output", size=SIDE)
    for found in (open_embedding(tmp_path), open_embedding(a, b), open_embedding(b, a)):
        start, end, _ = (known[name] for name in CLIP)
        expect_ids(found.text, "red", [start, known["red"], end, *[0] * 74])
        expect_picture(found.vision, (middle(scaled(10, 6)) - CLIP_MEAN) / CLIP_STD)
    c, d = a.rename(tmp_path / "one.onnx"), b.rename(tmp_path / "two.onnx")
    assert open_embedding(tmp_path).text.session.path == c and open_embedding(d, c).vision.session.path == d


def test_the_attention_mask_is_given_where_it_is_asked_for(tmp_path):
    known = write_transformers(tmp_path, "clip")
    write_text(tmp_path / "onnx" / "text_model.onnx", mask=True)
    start, end, pad = (known[name] for name in CLIP)
    assert pad != 0
    expect_ids(open_text(tmp_path), "red", [start, known["red"], end])


def test_a_network_of_one_size_decides_over_its_settings(tmp_path):
    write_transformers(tmp_path, "clip", size={"shortest_edge": 99}, crop_size={"height": 99, "width": 99})
    write_vision(tmp_path / "onnx" / "vision_model.onnx", size=SIDE)
    expect_picture(open_vision(tmp_path), (middle(scaled(10, 6)) - CLIP_MEAN) / CLIP_STD)


def test_vectors_are_of_unit_length_and_words_are_means_of_templates(tmp_path):
    known = write_transformers(tmp_path, "clip")
    text = open_text(tmp_path)
    both = text.embed(["chair", "a photo of a chair."])
    mean = both.mean(axis=0)
    np.testing.assert_allclose(text.words(["chair"])[0], mean / np.linalg.norm(mean), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(text.words(["red", "green"]), axis=1), 1.0, atol=1e-6)
    assert known["chair."] != known["chair"]
    both = text.embed(["something red", "a photo of something red."]).mean(axis=0)
    np.testing.assert_allclose(text.words(["something red"])[0], both / np.linalg.norm(both), atol=1e-6)


def test_the_most_faithful_file_is_taken_and_8_bit_pictures_are_warned_of(tmp_path):
    write_transformers(tmp_path, "clip")
    onnx = tmp_path / "onnx"
    for name in ("vision_model", "text_model"):
        for variant in ("quantized", "fp16", "int8"):
            shutil.copy(onnx / f"{name}.onnx", onnx / f"{name}_{variant}.onnx")
    (onnx / "model.onnx").write_bytes(b"not looked at")
    found = open_embedding(tmp_path)
    assert found.vision.session.path.name == "vision_model.onnx" and found.notes == ()
    (onnx / "vision_model.onnx").unlink()
    assert open_vision(tmp_path).session.path.name == "vision_model_fp16.onnx"
    (onnx / "vision_model_fp16.onnx").unlink()
    (note,) = open_embedding(tmp_path).notes
    assert "vision_model_int8.onnx: a vision network of 8 bits" in note


def test_a_text_file_that_cannot_be_opened_gives_way_to_another(tmp_path, monkeypatch):
    write_transformers(tmp_path, "clip")
    onnx = tmp_path / "onnx"
    shutil.copy(onnx / "text_model.onnx", onnx / "text_model_fp16.onnx")
    (onnx / "text_model.onnx").write_bytes(b"damaged")
    assert open_text(tmp_path).session.path.name == "text_model_fp16.onnx"
    # onnxruntime's fusions trip over some files of 16 bits: they are opened without.
    opened, real = [], towers.Session

    def tripping(path, *, optimize=True, **given):
        opened.append((path.name, optimize))
        if optimize:
            raise InputError(f"{path}: fusion")
        return real(path, optimize=optimize, **given)

    monkeypatch.setattr(towers, "Session", tripping)
    (onnx / "text_model.onnx").unlink()
    assert open_text(tmp_path).session.path.name == "text_model_fp16.onnx"
    assert opened == [("text_model_fp16.onnx", True), ("text_model_fp16.onnx", False)]


def joint(folder):
    shutil.rmtree(folder / "onnx")
    write_graph(
        folder / "onnx" / "model.onnx", [node("Flatten", ["pixel_values"], "image_embeds", axis=1)],
        {"input_ids": (("b", "n"), INT64), "pixel_values": (("b", 3, SIDE, SIDE), 1)},
        {"image_embeds": ("b", DIMENSION)}, {},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda at: write_text(at / "onnx" / "text_model.onnx", dimension=99), "108 numbers for pictures and 99"),
        (lambda at: (at / "onnx" / "vision_model.onnx").unlink(), "expected a vision network"),
        (lambda at: (at / "onnx" / "text_model.onnx").unlink(), "expected a text network"),
        (lambda at: (at / "tokenizer.json").unlink(), "expected its tokenizer.json"),
        (lambda at: (at / "tokenizer.json").write_text("{}"), "expected a tokenizer"),
        (lambda at: (at / "preprocessor_config.json").write_text('{"size": "big"}'), "how its pictures are prepared"),
        (lambda at: (at / "preprocessor_config.json").write_text('{"image_std": [0, 0, 0]}'), "how its pictures"),
        (joint, "expected words and pictures in a file each"),
        (shutil.rmtree, "found nothing"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(tmp_path, spoil, message):
    folder = tmp_path / "net"
    write_transformers(folder, "clip")
    spoil(folder)
    with pytest.raises(InputError) as caught:
        open_embedding(folder)
    assert message in str(caught.value) and str(folder) in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    write_transformers(tmp_path, "clip")
    monkeypatch.setitem(sys.modules, "tokenizers", None)
    with pytest.raises(InputError, match=r"expected the package tokenizers.*simaps-viz\[embedding\]"):
        open_text(tmp_path)


def test_settings_are_json_of_the_layout_only(tmp_path):
    write_transformers(tmp_path, "clip")
    (tmp_path / "config.json").write_text(json.dumps(["no", "object"]))
    assert open_text(tmp_path).rule.length == 77
