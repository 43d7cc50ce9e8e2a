"""`simaps demo`: an embedded place, rendered, mapped and shown."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import MappingOptions, Serving

PlaceName = Literal["cafe", "home", "office", "canteen", "shop"]
"""The embedded places."""
Level = Literal["none", "light", "medium", "heavy", "detector"]
"""How strong the simulated errors of the segmentation network are."""


@dataclass(frozen=True)
class Demo:
    """Render an embedded place, map it with simulated network errors, and open the workbench.

    Example: simaps demo home --errors medium --port 9000
    """

    place: tyro.conf.Positional[PlaceName] = "cafe"
    """What is rendered; the other places have 1,200 smaller frames each."""
    mapping: Annotated[MappingOptions, tyro.conf.arg(name="")] = field(default_factory=MappingOptions)
    errors: Level = "light"
    """Simulated errors of the segmentation network."""
    serving: Annotated[Serving, tyro.conf.arg(name="")] = field(default_factory=Serving)
    serve: bool = True
    """Serve the page; with --no-serve only prepare everything."""
    llm: str | None = None
    """A language model for the page's commands: MODEL[@ADDRESS], see simaps query."""

    def run(self) -> int:
        """Serve the shipped map at once where there is one; else render the place and build its map first."""
        from simaps_viz.console.terminal import note

        note(f"Preparing the {self.place}: frames, map and page; a few minutes the first time, then seconds.")
        from simaps_viz.app import demo, workbench
        from simaps_viz.build.pipeline import cache_folder
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.datasets.open import open_sequence
        from simaps_viz.mapping.mending import open_mending
        from simaps_viz.scenes.demo import ensure_demo

        serving = self.serving.options()
        shipped = None
        if self.serve and self.place == "cafe":
            shipped = demo.shipped_demo(self.mapping.method, self.mapping.config(), self.errors)
        if shipped is not None:
            note(f"On the map: {workbench.all_counts(shipped)}")
            demo.serve_shipped(shipped, llm=self.llm, **serving)
            return OK
        with stage_progress() as progress:
            manifest = ensure_demo(place=self.place, level=self.errors, cache_dir=cache_folder(), progress=progress)
            sequence = open_sequence(manifest)
            simap, recording = workbench.cached_build(sequence, self.mapping.method, self.mapping.config(), progress)
        note(f"On the map: {workbench.all_counts(simap)}")
        if self.serve:
            mending = open_mending(recording.with_suffix(".npz"), simap)
            workbench.serve(simap, recording=recording, llm=self.llm, mending=mending, **serving)
        return OK
