"""`simaps judge`: runs of a robot, judged by a person."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from simaps_viz.cli import OK
from simaps_viz.cli.options import Serving
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.console.progress import StageProgress
    from simaps_viz.evaluation.judging import JudgingSession
    from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class Judge:
    """Judge by eye whether robots did what was asked, blind and in random order.

    Example: simaps evaluate demo --task navigation --judge runs.jsonl; simaps judge runs.jsonl demo
    """

    session: tyro.conf.Positional[Path]
    """File of runs and answers, made with simaps evaluate --task navigation --judge FILE."""
    map: tyro.conf.Positional[str]
    """The world they were driven in: sequence folder or manifest with exact ids, "demo" for the embedded café, or a
    map file (.npz) of it."""
    serving: Annotated[Serving, tyro.conf.arg(name="")] = field(default_factory=Serving)

    def run(self) -> int:
        """Serve the page of a session of runs until Ctrl-C."""
        from simaps_viz.app import workbench
        from simaps_viz.console.progress import stage_progress

        serving = self.serving.options()
        with stage_progress() as progress:
            session, simap = open_judging(self.session, self.map, progress)
        workbench.serve(simap, recording=None, judging=session, **serving)
        return OK


def open_judging(session: Path, world: str, progress: "StageProgress") -> "tuple[JudgingSession, SIMap]":
    """Open a session of runs to judge, and the true map they were driven on.

    Args:
        session: written by ``simaps evaluate --judge``.
        world: a map file, or a sequence (or its manifest, or "demo") with exact ids, of which the map is made.
        progress: shows that making it takes a while.

    Raises:
        InputError: one of them is missing or damaged, or a run begins off the map.
    """
    from simaps_viz.evaluation.judging import resume_session
    from simaps_viz.evaluation.run import is_demo, open_for_evaluation
    from simaps_viz.evaluation.truth import find_truth, truth_as_map
    from simaps_viz.evaluation.world import observe_world
    from simaps_viz.mapping.file import load_map

    opened = resume_session(session)
    path = Path(world)
    if not is_demo(world) and not path.is_dir() and path.suffix != ".json":
        simap = load_map(path)
    else:
        exact = find_truth(open_for_evaluation(world, progress))
        progress("looking at the true world", 0, 1)
        simap = truth_as_map(observe_world(exact).tops)
        provenance = {**simap.provenance, "name": f"{exact.name}: the true map", "simulated": exact.simulated}
        simap = replace(simap, provenance=provenance)
        progress("looking at the true world", 1, 1)
    for run in opened.runs:
        x, y = run["start"][:2]
        if not simap.spec.contains(*simap.spec.cell_of(x, y)):
            raise InputError(f"{session}: expected runs on {world}, found one that starts off it, at ({x:g}, {y:g}) m")
    return opened, simap
