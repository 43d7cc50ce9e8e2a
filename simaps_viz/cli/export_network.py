"""`simaps export-network`: a checkpoint of transformers as a network for --segmentation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from simaps_viz.cli import OK


@dataclass(frozen=True)
class ExportNetwork:
    """Write a Mask2Former, MaskFormer, OneFormer or EoMT checkpoint of transformers as a network for --segmentation.

    Needs the extra: pip install "simaps-viz[export]".

    Example: simaps export-network ./my-mask2former -o mask2former.onnx
    """

    checkpoint: tyro.conf.Positional[str]
    """Folder written by save_pretrained, or a name on the Hugging Face hub (which is downloaded)."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Network to write (.onnx)."""
    size: tuple[int, int] | None = None
    """Height and width of its input; by default what the checkpoint's image processor says."""
    json: bool = False
    """Print the outcome as one JSON line."""

    def run(self) -> int:
        """Write the network and print how far its outputs are from the checkpoint's."""
        from simaps_viz.console.terminal import report
        from simaps_viz.segmentation.network_export import export_network

        done = export_network(self.checkpoint, self.output, size=self.size)
        words = f"input {done.size[0]} x {done.size[1]}, torch and onnxruntime differ by {done.difference:.1g} at most"
        record = {"event": "done", "output": str(done.path), "family": done.family, "input_size": list(done.size),
                  "difference": done.difference}  # fmt: skip
        report(record, f"{done.path}: {done.family}, {words}", json=self.json)
        return OK
