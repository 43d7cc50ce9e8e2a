"""`simaps evaluate`: methods scored against the truth, by counts, by driving, or piece by piece."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from simaps_viz.build import METHOD_NAMES
from simaps_viz.cli import OK
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.build.pipeline import BuildConfig
    from simaps_viz.console.progress import StageProgress
    from simaps_viz.datasets.sequence import PosedFrames
    from simaps_viz.evaluation.evaluate import Footprint
    from simaps_viz.structures import SIMap

_ONLY_WITH = {
    "counts": "instances", "picture": "instances", "record": "instances", "discrete": "navigation",
    "judge": "navigation", "predictions": "ap",
}  # fmt: skip
"""Options that the other tasks would ignore."""


@dataclass(frozen=True)
class Evaluate:
    """Score methods against the truth of a rendered scene, or against counts by eye; or drive on their maps.

    Example: simaps evaluate demo --errors light,medium --seeds 3 --picture maps.png
    """

    sequence: tyro.conf.Positional[str]
    """Sequence folder or manifest with exact ids, or "demo" for the embedded café, or
    "demo:home", "demo:office", "demo:canteen" or "demo:shop". With --task ap a map file (.npz)."""
    task: Literal["instances", "3d", "navigation", "ablation", "ap"] = "instances"
    """instances: is every object one instance? 3d: the same in space, with boxes and what is on and under what.
    navigation: a simulated robot carries out generated commands. ablation: what each piece of method evidence is
    worth. ap: a map on the mesh of a ScanNet or Replica scan (--truth), by the average precision of ScanNet,
    ScanNet200 or Replica."""
    methods: str = ",".join(METHOD_NAMES)
    """Separated by commas; also components-highest, paper-k9 and paper-literal."""
    errors: str = ""
    """Masks, separated by commas: none (exact), light, medium, heavy (simulated network errors), detector (simulated,
    as often as a small one was measured to err), precomputed (the sequence's own). By default light where the
    sequence's masks are exact."""
    seeds: int = 1
    """Seeds of the simulated errors; more than one gives mean ± spread."""
    counts: str = ""
    """Numbers counted by eye on a real scan, such as chair=11,table=2."""
    truth: Path | None = None
    """Manifest with exact ids, where it is not beside the sequence. ap: the scan's folder."""
    commands: int = 100
    """Navigation: how many commands a scene."""
    discrete: bool = False
    """Navigation: move in steps of 0.1 m and turns of 5°, as VLMaps does."""
    judge: Path | None = None
    """Navigation: also write the runs for people to judge in the workbench (simaps judge)."""
    predictions: Path | None = None
    """ap: write the instances here as files that the benchmark's own script scores."""
    picture: Path | None = None
    """Draw the maps side by side (.png)."""
    record: Path | None = None
    """Write the maps side by side as a recording for rerun (.rrd)."""
    output: Path | None = None
    """Write everything measured (.json)."""
    json: bool = False
    """Print everything measured as one JSON line."""

    def run(self) -> int:
        """Run one evaluation and print its tables; nothing is left half-written when anything is refused."""
        from simaps_viz.build.methods import check_method
        from simaps_viz.console.progress import stage_progress
        from simaps_viz.console.terminal import emit, say
        from simaps_viz.evaluation.run import split_names

        for option, task in _ONLY_WITH.items():
            if getattr(self, option) and self.task != task:
                raise InputError(f"--{option}: expected --task {task}, found --task {self.task}")
        for method in split_names("methods", self.methods):
            check_method(method)
        tasks = {
            "instances": _instances, "3d": _space, "navigation": _navigation, "ablation": _ablation, "ap": _ap,
        }  # fmt: skip
        task = tasks[self.task]
        with stage_progress(quiet=self.json) as progress:
            text, record = task(self, progress)
        if self.json:
            emit(record)
        else:
            say(text + "\n")
        return OK


def ablations() -> "list[tuple[str, BuildConfig]]":
    """Return complete method evidence, then the same with one piece removed at a time."""
    from simaps_viz.build.pipeline import BuildConfig

    whole = BuildConfig()
    votes, evidence, pooling = whole.votes, whole.evidence, whole.pooling
    return [
        ("evidence", whole),
        ("no votes", replace(whole, votes=replace(votes, enabled=False))),
        ("no errors learned", replace(whole, votes=replace(votes, rounds=0))),
        ("no exact masks rule", replace(whole, votes=replace(votes, exact_below=0.0))),
        ("no lent votes", replace(whole, votes=replace(votes, neighbours=0.0))),
        ("stuff votes fully", replace(whole, votes=replace(votes, stuff=1.0))),
        ("nothing votes fully", replace(whole, votes=replace(votes, nothing=1.0))),
        ("no scores", replace(whole, votes=replace(votes, scores=False))),
        ("no floor rule", replace(whole, votes=replace(votes, floor_m=0.0))),
        ("only neighbours", replace(whole, evidence=replace(evidence, ranges=(1,)))),
        ("no 'different'", replace(whole, evidence=replace(evidence, different=False))),
        ("open gaps join", replace(whole, evidence=replace(evidence, gap_cells=-1))),
        ("touching is nothing", replace(whole, pooling=replace(pooling, touching_same=0.0))),
        ("components", replace(whole, method="components")),
    ]


def _instances(settings: Evaluate, progress: "StageProgress") -> tuple[str, dict[str, Any]]:
    from simaps_viz.build.methods import build
    from simaps_viz.evaluation.run import EvaluationConfig, run_evaluation
    from simaps_viz.io.files import check_ending, check_output

    config = EvaluationConfig(
        sequence=settings.sequence, methods=settings.methods, errors=settings.errors, seeds=settings.seeds,
        counts=settings.counts, truth=settings.truth, picture=settings.picture, output=settings.output,
    )  # fmt: skip
    if settings.record is not None:  # before anything is computed
        check_ending(settings.record, ".rrd", "a recording's name")
        check_output(settings.record)
    result = run_evaluation(config, build, store=_store, progress=progress)
    if settings.record is not None:
        from simaps_viz.recorder.whole_map import record_comparison

        panels = result.comparison.panels
        pictures = [(f"{p.title} {p.subtitle}", p.colors, p.instance) for p in panels]
        record_comparison(f"{result.name}: methods side by side", pictures, settings.record)
    return "\n".join(table.text() for table in result.tables()), result.to_json()


def _store(method: str, simap: "SIMap") -> "Footprint":
    """Return the size of what a method stores in addition to the map (VLMaps' embeddings), in memory and on disk."""
    from simaps_viz.evaluation.evaluate import Footprint

    held = int(simap.provenance.get("embedding_bytes_held", 0))
    return Footprint(held, held)


def _space(settings: Evaluate, progress: "StageProgress") -> tuple[str, dict[str, Any]]:
    from simaps_viz.build.methods import build
    from simaps_viz.evaluation.run import split_names
    from simaps_viz.evaluation.space import evaluate_space

    sequence, asked = _opened(settings, progress)
    report = evaluate_space(sequence, split_names("methods", settings.methods), build=build, **asked)
    return report.table().text(), _written(settings, report.to_json())


def _navigation(settings: Evaluate, progress: "StageProgress") -> tuple[str, dict[str, Any]]:
    from simaps_viz.build.methods import build
    from simaps_viz.evaluation.judging import start_session
    from simaps_viz.evaluation.navigation import TRUE_MAP, evaluate_navigation, navigation_json, navigation_text
    from simaps_viz.evaluation.run import split_names

    if settings.judge is not None and settings.judge.exists():
        raise InputError(f"{settings.judge}: expected a new session file, found one; it would lose what was judged")
    sequence, asked = _opened(settings, progress)
    report = evaluate_navigation(
        sequence, (TRUE_MAP, *split_names("methods", settings.methods)), build=build, commands=settings.commands,
        actions="discrete" if settings.discrete else "continuous", **asked,
    )  # fmt: skip
    record = _written(settings, navigation_json(report))
    if settings.judge is not None:
        start_session(settings.judge, [run.to_json() for run in report.runs if run.method != TRUE_MAP])
    return navigation_text(report), record


def _ablation(settings: Evaluate, progress: "StageProgress") -> tuple[str, dict[str, Any]]:
    from simaps_viz.build.pipeline import build_map
    from simaps_viz.evaluation.evaluate import evaluate_variants
    from simaps_viz.evaluation.report import ablation_table, report_json

    sequence, asked = _opened(settings, progress, "none", "light", "medium", "heavy")
    report = evaluate_variants(sequence, ablations(), build=build_map, **asked)
    return ablation_table(report).text(), _written(settings, report_json(report))


def _ap(settings: Evaluate, progress: "StageProgress") -> tuple[str, dict[str, Any]]:
    from simaps_viz.evaluation.average_precision import evaluate_mesh
    from simaps_viz.mapping.file import load_map

    asked = Evaluate(settings.sequence)
    if any(getattr(settings, name) != getattr(asked, name) for name in ("methods", "errors", "seeds")):
        raise InputError("--task ap: expected only a map, found --methods, --errors or --seeds of maps to build")
    if settings.truth is None:
        raise InputError("--task ap: expected the folder of a ScanNet or Replica scan with --truth, found none")
    progress("scoring on the benchmark's mesh", 0, 1)
    text, record = evaluate_mesh(load_map(Path(settings.sequence)), settings.truth, settings.predictions)
    progress("scoring on the benchmark's mesh", 1, 1)
    return text, _written(settings, {"map": settings.sequence, **record})


def _opened(settings: Evaluate, progress: "StageProgress", *errors: str) -> "tuple[PosedFrames, dict[str, Any]]":
    """Open the sequence, and return what every task but "instances" is asked; ``errors`` are the default ones."""
    from simaps_viz.evaluation.run import open_for_evaluation, split_names

    sequence = open_for_evaluation(settings.sequence, progress)
    errors = errors or ("light" if sequence.ground_truth else "precomputed",)
    return sequence, {
        "errors": split_names("errors", settings.errors) or errors, "seeds": range(settings.seeds),
        "truth": settings.truth, "progress": progress,
    }  # fmt: skip


def _written(settings: Evaluate, record: dict[str, Any]) -> dict[str, Any]:
    """Return what was measured, written to the output where there is one."""
    from simaps_viz.evaluation.run import write_json

    if settings.output is not None:
        write_json(record, settings.output)
    return record
