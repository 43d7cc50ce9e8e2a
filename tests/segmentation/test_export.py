"""Checkpoints of transformers as ONNX files, on small models with random weights; skipped without the extra export."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tiny_networks import segment_image

from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.segmentation.network_export import CLASSES, INPUT, MASKS, export_network, input_size
from simaps_viz.segmentation.recognise import NetworkSettings, open_network

NAMES = {0: "chair", 1: "table", 2: "wall", 3: "floor"}
HAS_EXTRA = all(importlib.util.find_spec(name) for name in ("torch", "transformers", "onnx"))
needs_extra = pytest.mark.skipif(not HAS_EXTRA, reason="the extra export (torch, transformers, onnx) is not installed")
SIZES = {
    "mask2former": {"height": 64, "width": 64},
    "maskformer": {"shortest_edge": 64, "longest_edge": 96},
    "oneformer": {"shortest_edge": 64, "longest_edge": 96},
    "eomt": {"shortest_edge": 64, "longest_edge": 64},
}


QUERIES = {"class_predictor": 8.0, "mask_embedder": 8.0, "queries_embedder": 8.0}
LOUDER = {
    "mask2former": QUERIES,
    "maskformer": QUERIES,
    "oneformer": {"queries_embedder": 30.0, "query_transformer": 8.0, "class_embed": 30.0, "mask_embed": 2.0},
    "eomt": QUERIES,
}
"""By how much some of the random weights are multiplied."""


def small_model(family: str, transformers: Any) -> Any:
    swin = transformers.SwinConfig(
        image_size=64, embed_dim=16, depths=[1, 1, 1, 1], num_heads=[2, 2, 2, 2], window_size=4,
        out_features=["stage1", "stage2", "stage3", "stage4"],
    )  # fmt: skip
    if family == "mask2former":
        config = transformers.Mask2FormerConfig(
            backbone_config=swin, feature_size=32, mask_feature_size=32, hidden_dim=32, encoder_feedforward_dim=32,
            dim_feedforward=32, encoder_layers=1, decoder_layers=2, num_attention_heads=2, num_queries=12,
            id2label=NAMES,
        )  # fmt: skip
        return transformers.Mask2FormerForUniversalSegmentation(config)
    if family == "maskformer":
        detr = transformers.DetrConfig(
            d_model=32, encoder_layers=1, decoder_layers=1, encoder_ffn_dim=32, decoder_ffn_dim=32, num_queries=12,
            encoder_attention_heads=2, decoder_attention_heads=2,
        )  # fmt: skip
        config = transformers.MaskFormerConfig(
            backbone_config=swin, decoder_config=detr, fpn_feature_size=32, mask_feature_size=32, id2label=NAMES
        )
        return transformers.MaskFormerForInstanceSegmentation(config)
    if family == "oneformer":
        config = transformers.OneFormerConfig(
            backbone_config=swin, conv_dim=32, mask_dim=32, hidden_dim=32, encoder_feedforward_dim=32,
            dim_feedforward=32, encoder_layers=1, decoder_layers=3, num_attention_heads=2, num_queries=12,
            text_encoder_width=32, text_encoder_num_layers=1, text_encoder_vocab_size=16, id2label=NAMES,
        )  # fmt: skip
        return transformers.OneFormerForUniversalSegmentation(config)
    config = transformers.EomtConfig(
        hidden_size=32, num_hidden_layers=4, num_attention_heads=2, intermediate_size=64, image_size=64, patch_size=16,
        num_queries=12, num_blocks=2, num_upscale_blocks=1, num_register_tokens=1, id2label=NAMES,
    )  # fmt: skip
    return transformers.EomtForUniversalSegmentation(config)


WORDS = ("<pad>", "the", "task", "is", "panoptic")
TASK = np.array([[1, 2, 3, 4, *[0] * 73]])
"""What OneFormer's own processor makes of the task with these words: padding counts as 0."""


def write_tokenizer(folder: Path) -> None:
    """Write a tokenizer that knows four words, in the place of CLIP's."""
    tokenizers, transformers = (importlib.import_module(name) for name in ("tokenizers", "transformers"))
    made = tokenizers.Tokenizer(tokenizers.models.WordLevel({word: i for i, word in enumerate(WORDS)}, "<pad>"))
    made.pre_tokenizer = tokenizers.pre_tokenizers.Whitespace()
    transformers.PreTrainedTokenizerFast(tokenizer_object=made, pad_token="<pad>").save_pretrained(folder)


def checkpoint(folder: Path, family: str) -> Any:
    torch, transformers = (importlib.import_module(name) for name in ("torch", "transformers"))
    transformers.logging.set_verbosity_error()
    torch.manual_seed(0)
    model = small_model(family, transformers).eval()
    with torch.no_grad():  # random weights make queries alike and sure of nothing: a rounding error would decide
        for name, weight in model.named_parameters():
            for part, factor in LOUDER.get(family, {}).items():
                if part in name:
                    weight.mul_(factor)
        if family == "oneformer":  # its queries, made of one token, would all say "no object"
            model.model.transformer_module.decoder.class_embed.bias[-1] = -9.0
    model.save_pretrained(folder)
    processor = {"size": SIZES[family], "image_mean": [0.5] * 3, "image_std": [0.25] * 3, "do_normalize": True}
    (folder / "preprocessor_config.json").write_text(json.dumps(processor))
    if family == "eomt":
        model.attn_mask_probs.zero_()
    if family == "oneformer":
        write_tokenizer(folder)
    return model


@needs_extra
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("family", SIZES)
def test_exports_give_what_torch_gives_down_to_the_panoptic_map(tmp_path, family):
    torch = importlib.import_module("torch")
    model = checkpoint(tmp_path, family)
    output = tmp_path / "net.onnx"
    done = export_network(str(tmp_path), output)
    assert done.family == family and done.difference <= 1e-3
    assert done.size == ((64, 96) if "longest_edge" in SIZES[family] and family != "eomt" else (64, 64))
    settings = NetworkSettings(providers=("cpu",), threads=1, score=0.3, mask=0.5, overlap=0.1)
    network: Any = open_network(output, settings)[0]
    assert network.labels == tuple(NAMES.values()) and network.is_thing == (True, True, False, False)
    rng = np.random.default_rng(0)
    color = cv2.resize(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8), (64, 48), interpolation=cv2.INTER_NEAREST)
    prepared = network.prepare(color)
    task = {"task_inputs": torch.from_numpy(TASK)} if family == "oneformer" else {}
    with torch.no_grad():
        out = model(pixel_values=torch.from_numpy(prepared), **task)
    expected = [out.class_queries_logits.numpy(), out.masks_queries_logits.numpy()]
    for ours, theirs in zip(network.infer(prepared), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-3)
    found = segment_image(network, color)
    np.testing.assert_array_equal(found.ids, network.decode(expected, 48, 64).ids)
    assert found.segments


@needs_extra
@pytest.mark.filterwarnings("ignore")
def test_what_is_no_checkpoint_is_refused(tmp_path, capsys):
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    assert main(["export-network", str(tmp_path), "-o", str(tmp_path / "n.onnx")]) == 2
    assert "expected a checkpoint of mask2former, maskformer, oneformer, eomt" in capsys.readouterr().err.replace(
        "\n", ""
    )
    assert not list(tmp_path.glob("*.onnx"))


@needs_extra
@pytest.mark.filterwarnings("ignore")
def test_oneformer_without_its_tokenizer_is_refused(tmp_path):
    checkpoint(tmp_path, "oneformer")
    for path in tmp_path.glob("tokenizer*"):
        path.unlink()
    with pytest.raises(InputError, match="expected OneFormer's tokenizer beside the model") as caught:
        export_network(str(tmp_path), tmp_path / "n.onnx")
    assert "\n" not in str(caught.value) and not list(tmp_path.glob("*.onnx"))


@pytest.mark.skipif(HAS_EXTRA, reason="the extra export is installed")
def test_without_the_extra_it_is_named(tmp_path):
    with pytest.raises(InputError, match=r"expected the package \w+, .* pip install 'simaps-viz\[export\]'"):
        export_network("x", tmp_path / "n.onnx")


@pytest.mark.parametrize(
    ("family", "size", "expected"),
    [
        ("mask2former", {"height": 384, "width": 640}, (384, 640)),
        ("maskformer", {"shortest_edge": 640, "longest_edge": 2560}, (640, 864)),
        ("maskformer", 512, (512, 704)),
        ("maskformer", {}, (480, 640)),
        ("eomt", {"shortest_edge": 640, "longest_edge": 640}, (640, 640)),
    ],
)
def test_the_input_is_as_large_as_the_image_processor_says(family, size, expected):
    assert input_size(family, {"size": size}, None) == expected
    assert (INPUT, CLASSES, MASKS) == ("pixel_values", "class_queries_logits", "masks_queries_logits")
