"""`simaps describe`: the colours of a map's objects, and their vectors in an embedding of pictures and words."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import Networks
from simaps_viz.errors import InputError


@dataclass(frozen=True)
class Describe:
    """Describe the objects of a map, so that free words ("red mug") find them, with your own CLIP or SigLIP.

    The network (also MobileCLIP) sees up to 4 views of each object. Without --embedding, only colours are added.

    Example: simaps describe cafe.npz --embedding ./siglip-base-patch16-224
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    embedding: tuple[Path, ...] = ()
    """Folder with the network in ONNX, as transformers.js, Immich or open_clip have it; or its two files (extra
    "embedding")."""
    sequence: Path | None = None
    """What the map was built from; by default the path that it says."""
    segmentation: str = "precomputed"
    """Where its masks came from: "precomputed", or the network (.onnx) or table (.json) that the map was built with."""
    network: Annotated[Networks, tyro.conf.arg(name="")] = field(default_factory=Networks)
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Map file to write; by default the map itself, to which everything is added."""
    json: bool = False
    """Print one JSON line."""

    def run(self) -> int:
        """Describe the map and write it."""
        from simaps_viz.build.pipeline import cache_folder
        from simaps_viz.build.seen_colors import with_colors
        from simaps_viz.cli.segment import open_segmented
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import report
        from simaps_viz.embedding.describe import describe_to_file
        from simaps_viz.embedding.towers import open_embedding
        from simaps_viz.io.files import check_ending
        from simaps_viz.mapping.file import check_writable, load_map, save_map

        simap, output = load_map(self.map), self.output or self.map
        check_ending(output, ".npz", "a map's name")
        check_writable(output)
        source = self.sequence or Path(simap.provenance.get("sequence") or "")
        if source == Path():
            raise InputError(
                f"{self.map}: expected --sequence, what the map was built from, as it does not say; found none"
            )
        embedding = open_embedding(*self.embedding) if self.embedding else None
        with stage_progress(quiet=self.json) as progress:
            sequence = open_segmented(
                source, self.segmentation, self.network, cache_folder(), progress, quiet=self.json
            )
            if embedding is None:
                simap = with_colors(simap, sequence)
                save_map(simap, output)
            else:
                simap = describe_to_file(simap, sequence, embedding, output, progress)
        notes = [] if embedding is None else list(embedding.notes)
        colored = sum(simap.color_of(one) is not None for one in simap.instances)
        vectors = 0 if simap.appearance is None else len(simap.appearance.vectors)
        record = {"event": "done", "map": str(output), "instances": len(simap.instances), "colored": colored,
                  "described": vectors, "notes": notes}  # fmt: skip
        text = f"{output}: {colored} of {len(simap.instances)} objects have a colour, {vectors} are described"
        report(record, *notes, text, json=self.json)
        return OK
