"""Write universal segmentation checkpoints of Hugging Face transformers as ONNX files that `--segmentation` takes.

Three things have to be worked around. The deformable attention of Mask2Former and OneFormer samples on a grid that
the exported graph computes in doubles, which onnxruntime's GridSample refuses: the grid is cast to the sampled values'
type. EoMT draws random numbers to decide where its masks guide attention while training; a finished model does without,
so the probabilities are set to 0. OneFormer is told its task in words: the tokens of "the task is panoptic" become a
part of the file. The exporter that follows TorchScript is used: the newer one fails on Mask2Former.

Needs the extra ``export`` (torch, transformers, onnx). The file's metadata hold the class names and what has to be done
to a picture.
"""

import importlib
import json
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.errors import InputError, needs_extra, one_line
from simaps_viz.io.files import replacing

FAMILIES = ("mask2former", "maskformer", "oneformer", "eomt")
OPSET = 17
TOLERANCE = 1e-3
"""Largest difference between torch and onnxruntime on the same random picture."""
INPUT, CLASSES, MASKS = "pixel_values", "class_queries_logits", "masks_queries_logits"
TASK = "the task is panoptic"
"""What OneFormer's own processor says for panoptic segmentation."""
_DIVISOR = 32


@dataclass(frozen=True)
class Exported:
    """What was written."""

    path: Path
    family: str
    size: tuple[int, int]
    """Height and width of the input."""
    difference: float
    """Largest between torch and onnxruntime."""


def export_network(checkpoint: str, output: Path, *, size: tuple[int, int] | None = None) -> Exported:
    """Write a checkpoint as ONNX and check the file against torch.

    Args:
        checkpoint: a folder written by transformers' ``save_pretrained``, or a name on the Hugging Face hub.
        output: the file to write (.onnx).
        size: height and width of the input; None: what the checkpoint's image processor says.

    Raises:
        InputError: torch and transformers are not installed, the checkpoint cannot be loaded or is of another family,
            or the file does not give what torch gives.
    """
    torch, transformers, onnx = _libraries()
    if output.suffix != ".onnx" or not output.parent.is_dir():
        raise InputError(f"{output}: expected a file to write (.onnx) in a folder that is there")
    transformers.logging.set_verbosity_error()
    model, processor = _load(transformers, checkpoint)
    family = model.config.model_type
    if family not in FAMILIES:
        raise InputError(f"{checkpoint}: expected a checkpoint of {', '.join(FAMILIES)}, found {family}")
    if family == "eomt":
        with torch.no_grad():
            model.attn_mask_probs.zero_()
    size = size or input_size(family, processor, model.config)
    network = _two_outputs(torch, model, _constants(torch, transformers, checkpoint, model.config))
    picture = torch.rand((1, 3, *size), generator=torch.Generator().manual_seed(0)) * 4.0 - 2.0
    try:
        with replacing(output, "the network") as temporary:
            with _grids_like_values(torch), warnings.catch_warnings(), torch.no_grad():
                warnings.simplefilter("ignore")  # of the tracer, about sizes that are fixed on purpose
                torch.onnx.export(
                    network, (picture,), str(temporary), dynamo=False, opset_version=OPSET,
                    input_names=[INPUT], output_names=[CLASSES, MASKS],
                )  # fmt: skip
            _add_metadata(onnx, temporary, metadata(family, processor, model.config))
            difference = _difference(torch, network, temporary, size)
            if not difference <= TOLERANCE:
                raise InputError(f"{checkpoint}: expected torch and onnxruntime to agree within {TOLERANCE:g}, "
                                 f"found a difference of {difference:.2g}")  # fmt: skip
    except RuntimeError as error:  # what torch raises when it cannot trace or translate
        raise InputError(f"{checkpoint}: expected to export it, found: {str(error).splitlines()[0][:200]}") from error
    return Exported(output, family, size, difference)


def input_size(family: str, processor: dict[str, Any], config: Any) -> tuple[int, int]:
    """Return height and width of the input that an image processor's settings mean.

    Where only edges are limited, as for MaskFormer, the input is a picture of 4:3 of that size, rounded up to 32.
    """
    size = processor.get("size") or {}
    if isinstance(size, int):
        size = {"shortest_edge": size}
    if "height" in size:
        return int(size["height"]), int(size["width"])
    if family == "eomt":
        side = int(size.get("longest_edge") or size.get("shortest_edge") or config.image_size)
        return side, side
    short = int(size.get("shortest_edge") or 480)
    long = min(round(short * 4 / 3), int(size.get("longest_edge") or 10**6))
    return _rounded(short), _rounded(long)


def metadata(family: str, processor: dict[str, Any], config: Any) -> dict[str, str]:
    """Return what the file has to say about itself."""
    kept = ("size", "do_rescale", "rescale_factor", "do_normalize", "image_mean", "image_std")
    names = {str(i): config.id2label[i] for i in sorted(config.id2label)}
    return {
        "simaps.family": family,
        "simaps.picture": json.dumps({key: processor[key] for key in kept if processor.get(key) is not None}),
        "id2label": json.dumps(names),
    }


def _libraries() -> tuple[Any, Any, Any]:
    with needs_extra("export", "export-network"):  # by name: they are big, and pyright does not know them
        torch, transformers, onnx = (importlib.import_module(name) for name in ("torch", "transformers", "onnx"))
    return torch, transformers, onnx


def _load(transformers: Any, checkpoint: str) -> tuple[Any, dict[str, Any]]:
    """Load the model, and the settings of its image processor ({} when it has none)."""
    try:
        model = transformers.AutoModelForUniversalSegmentation.from_pretrained(checkpoint).eval()
        processor, _ = transformers.ImageProcessingMixin.get_image_processor_dict(checkpoint)
    except (OSError, ValueError, KeyError) as error:
        known = ", ".join(FAMILIES)
        raise InputError(f"{checkpoint}: expected a checkpoint of {known}, found: {one_line(error)}") from None
    return model, processor


def _constants(torch: Any, transformers: Any, checkpoint: str, config: Any) -> dict[str, Any]:
    """Return the inputs besides the picture, the same for every picture: OneFormer's task, int64 [1, tokens].

    Raises:
        InputError: the checkpoint has no tokenizer to write it with.
    """
    if config.model_type != "oneformer":
        return {}
    length = config.task_seq_len
    try:
        tokenizer = transformers.AutoTokenizer.from_pretrained(checkpoint)
        made = tokenizer([TASK], padding="max_length", max_length=length, truncation=True)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{checkpoint}: expected OneFormer's tokenizer beside the model, found: {one_line(error)}"
        ) from None
    tokens = np.array(made["input_ids"], dtype=np.int64) * np.array(made["attention_mask"], dtype=np.int64)
    read_back = "".join(tokenizer.decode(made["input_ids"][0], skip_special_tokens=True).split())
    if tokens.shape != (1, length) or read_back != TASK.replace(" ", ""):
        # Without files transformers makes a tokenizer that knows no word, and says nothing.
        raise InputError(f"{checkpoint}: expected OneFormer's tokenizer beside the model, found none that can "
                         f'write "{TASK}"')  # fmt: skip
    return {"task_inputs": torch.from_numpy(tokens)}


def _two_outputs(torch: Any, model: Any, constants: dict[str, Any]) -> Any:
    class Network(torch.nn.Module):
        """The model, with two outputs instead of a record of a dozen."""

        def __init__(self) -> None:
            super().__init__()
            self.model = model

        def forward(self, pixel_values: Any) -> tuple[Any, Any]:
            outputs = self.model(pixel_values=pixel_values, **constants)
            return outputs.class_queries_logits, outputs.masks_queries_logits

    return Network().eval()  # the exporter puts the whole back into the mode it found the outermost in


@contextmanager
def _grids_like_values(torch: Any) -> Iterator[None]:
    """Sample on grids of the sampled values' type while the block runs."""
    original: Callable[..., Any] = torch.nn.functional.grid_sample

    def sample(values: Any, grid: Any, *args: Any, **keywords: Any) -> Any:
        return original(values, grid.to(values.dtype), *args, **keywords)

    torch.nn.functional.grid_sample = sample
    try:
        yield
    finally:
        torch.nn.functional.grid_sample = original


def _add_metadata(onnx: Any, path: Path, entries: dict[str, str]) -> None:
    model = onnx.load(str(path))
    onnx.helper.set_model_props(model, entries)
    onnx.save(model, str(path))


def _difference(torch: Any, network: Any, path: Path, size: tuple[int, int]) -> float:
    """Return the largest difference between torch and the file on another picture than the one it was traced with."""
    from simaps_viz.segmentation.session import Session  # noqa: PLC0415 - onnxruntime is slow to import

    picture = torch.rand((1, 3, *size), generator=torch.Generator().manual_seed(1)) * 4.0 - 2.0
    with torch.no_grad():
        expected = network(picture)
    found = Session(path, providers=("cpu",)).run({INPUT: picture.numpy()}, [CLASSES, MASKS])
    return max(float(np.abs(e.numpy() - f).max()) for e, f in zip(expected, found, strict=True))


def _rounded(pixels: int) -> int:
    return -(-pixels // _DIVISOR) * _DIVISOR
