"""A map scored on the mesh of a ScanNet or Replica scene, by average precision as these benchmarks define it.

Every vertex of the benchmark's mesh takes the instance of the map's nearest voxel. Instances and objects of fewer than
100 vertices do not count. An instance is right if it overlaps an object of its class by more than a threshold; what
lies mostly on vertices that nobody annotated, or on classes that are not scored, is neither right nor false. AP is the
mean over the thresholds .5, .55 to .9; AP50 and AP25 are at .5 and .25. This follows the script that ScanNet publishes
(evaluate_semantic_instance.py) also where that is peculiar; its scores of the predictions written here are the same.
"""

import csv
import io
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from trimesh.exchange.ply import load_ply

from simaps_viz.datasets.manifest import few, read_json
from simaps_viz.errors import InputError
from simaps_viz.evaluation.report import FORMAT, Measured, TextTable
from simaps_viz.geometry import transform_points
from simaps_viz.io.files import write_all
from simaps_viz.io.limits import MAX_CLOUD_BYTES, MAX_TEXT_BYTES, read_bytes
from simaps_viz.mapping.in_space import all_instances, majority, space_points
from simaps_viz.structures import SIMap

OVERLAPS: Final = np.append(np.arange(0.5, 0.95, 0.05), 0.25)
MIN_VERTICES: Final = 100
REACH_M: Final = 0.1
"""A vertex farther than this from every voxel of the map has no instance."""
CLASSES: Final[Mapping[str, Mapping[str, int]]] = json.loads(
    package_files("simaps_viz.evaluation").joinpath("benchmark_classes.json").read_text("utf-8")
)
"""{benchmark: {class that it scores: its number}}."""
_LABELS_TABLE = "scannetv2-labels.combined.tsv"
_REPLICA_NAMES = {"couch": "sofa", "dining table": "table", "potted plant": "indoor-plant", "tv": "tv-screen"}
"""COCO's names of Replica's classes, where they differ; ScanNet's table has its own."""


@dataclass(frozen=True, eq=False)
class MeshTruth:
    """The annotated objects of one scene, as one benchmark scores them."""

    benchmark: str
    """Key of ``CLASSES``."""
    scene: str
    vertices: NDArray
    """float64 [n, 3], metres, world frame of the scan's poses."""
    objects: NDArray
    """int64 [n], object of each vertex, 0 = none."""
    labels: Mapping[int, str]
    """{object: class}, of scored classes only."""
    names: Mapping[str, str]
    """{other name: class}."""


@dataclass(frozen=True)
class ClassScore:
    """Average precision of a class; None where the scene has no object of it."""

    ap: float | None
    ap50: float | None
    ap25: float | None
    true: int
    found: int


def average_precision(
    objects: NDArray, labels: Mapping[int, str], found: NDArray, found_labels: Mapping[int, str],
    scores: Mapping[int, float],
) -> dict[str, ClassScore]:  # fmt: skip
    """Score instances on the vertices of a mesh, class by class.

    Args:
        objects: int64 [n], object of each vertex, 0 = none.
        labels: {object: class}, of scored classes only.
        found: int64 [n], instance of each vertex, 0 = none.
        found_labels: {instance: class}, of scored classes only.
        scores: {instance: confidence}.
    """
    true_ids, found_ids = np.array(sorted(labels), np.int64), np.array(sorted(found_labels), np.int64)
    common = np.zeros((len(true_ids) + 1, len(found_ids) + 1), np.int64)
    np.add.at(common, (_places(true_ids, objects), _places(found_ids, found)), 1)
    true_size, found_size, void = common[:-1].sum(axis=1), common[:, :-1].sum(axis=0), common[-1, :-1]
    common = common[:-1, :-1]
    iou = common / np.maximum(true_size[:, None] + found_size - common, 1)
    true_label, found_label = (np.array([names[int(i)] for i in ids], object)
                               for names, ids in ((labels, true_ids), (found_labels, found_ids)))  # fmt: skip
    result = {}
    for label in sorted({*labels.values(), *found_labels.values()}):
        mine = np.flatnonzero((found_label == label) & (found_size >= MIN_VERTICES))
        asked, small = ((true_label == label) & (large == (true_size >= MIN_VERTICES)) for large in (True, False))
        ignored = (void[mine] + common[small][:, mine].sum(axis=0)) / found_size[mine]
        sure = np.array([scores[int(found_ids[i])] for i in mine])
        table = iou[asked][:, mine], iou[small][:, mine], ignored, sure
        if asked.any():
            ap = [_precision(*table, overlap) for overlap in OVERLAPS]
            result[label] = ClassScore(float(np.mean(ap[:-1])), ap[0], ap[-1], int(asked.sum()), len(mine))
        elif len(mine):
            result[label] = ClassScore(None, None, None, 0, len(mine))
    return result


def _places(ids: NDArray, numbers: NDArray) -> NDArray:
    """Return where each number is in ascending ids, or one past their end."""
    at = np.searchsorted(ids, numbers)
    return np.where(np.append(ids, -1)[at] == numbers, at, len(ids))


def _precision(iou: NDArray, small_iou: NDArray, ignored: NDArray, sure: NDArray, overlap: float) -> float:
    """Return the average precision of a class at one overlap.

    Args:
        iou: float64 [objects, instances]; at least one object.
        small_iou: the same with objects too small to count.
        ignored: [instances], share of their vertices that is not held against them.
        sure: [instances], confidence.
        overlap: what an instance has to have more of to be right.
    """
    fits, taken, judged, missed = iou > overlap, set[int](), list[tuple[bool, float]](), 0
    for row in fits:
        over = [int(f) for f in np.flatnonzero(row) if f not in taken]
        if over:  # the surest is right, the others are false; only the first is used up
            taken.add(over[0])
            judged += [(at == 0, value) for at, value in enumerate(sorted(sure[over], reverse=True))]
        else:
            missed += 1
    alone = ~fits.any(axis=0) & ~(small_iou > overlap).any(axis=0) & (ignored <= overlap)
    judged += [(False, value) for value in sure[alone]]
    if not judged:
        return 0.0
    # The curve has a point for each confidence, and one of precision 1 and recall 0; each precision counts for half of
    # the steps of recall on both of its sides.
    right, value = np.array([one for one, _ in judged]), np.array([one for _, one in judged])
    at_least = value >= np.unique(value)[:, None]
    hits = (at_least & right).sum(axis=1)
    precision = np.append(hits / at_least.sum(axis=1), 1.0)
    recall = np.append(hits / (right.sum() + missed), 0.0)
    padded = np.concatenate([recall[:1], recall, [0.0]])
    return float(precision @ (padded[:-2] - padded[2:]) / 2.0)


def read_truth(folder: Path) -> list[MeshTruth]:
    """Read the annotation of a ScanNet scan (as ScanNet and as ScanNet200 score it) or of a Replica scene.

    Raises:
        InputError: a file is missing, damaged or does not fit the others.
    """
    inner = folder / "habitat" if (folder / "habitat").is_dir() else folder
    if (inner / "mesh_semantic.ply").is_file():
        return [_replica(inner)]
    tables = [f for f in sorted(folder.glob("*.aggregation.json")) if not f.name.endswith("_vh_clean.aggregation.json")]
    if tables:
        return _scannet(tables[0])
    found = few(sorted(path.name for path in folder.iterdir())) if folder.is_dir() else ""
    raise InputError(
        f"{folder}: expected a ScanNet scan (SCENE.aggregation.json) or a Replica scene (habitat/mesh_semantic.ply), "
        f"found {found or 'nothing'}"
    )


def _scannet(table: Path) -> list[MeshTruth]:
    scene = table.name.removesuffix(".aggregation.json")
    vertices = _ply(table.with_name(f"{scene}_vh_clean_2.ply"))[0]
    objects, raw = np.zeros(len(vertices), np.int64), dict[int, str]()
    file = table.with_name(f"{scene}_vh_clean_2.0.010000.segs.json")
    with _expecting(file, f"segIndices, a number for each of {len(vertices)} vertices"):
        segments = np.array(read_json(file)["segIndices"], np.int64).reshape(objects.shape)
    with _expecting(table, "segGroups with objectId, label and segments"):
        for group in read_json(table)["segGroups"]:
            number = int(group["objectId"]) + 1
            objects[np.isin(segments, np.array(group["segments"], np.int64))] = number
            raw[number] = str(group["label"])
    places = [place / _LABELS_TABLE for place in (table.parent, *table.resolve().parents[1:4])]
    path = next((place for place in places if place.is_file()), places[0])
    text = read_bytes(path, MAX_TEXT_BYTES, "ScanNet's table of labels, here or in a folder above")
    truths = []
    for benchmark, column in (("ScanNet", "nyu40id"), ("ScanNet200", "id")):
        label_of = {str(number): label for label, number in CLASSES[benchmark].items()}
        with _expecting(path, "columns raw_category, id and nyu40id, separated by tabs"):
            rows = csv.DictReader(io.StringIO(text.decode("utf-8-sig")), delimiter="\t")
            names = {row["raw_category"]: label_of[row[column]] for row in rows if row[column] in label_of}
        labels = {number: names[name] for number, name in raw.items() if name in names}
        truths.append(MeshTruth(benchmark, scene, vertices, objects, labels, names))
    return truths


def _replica(folder: Path) -> MeshTruth:
    path, table = folder / "mesh_semantic.ply", folder / "info_semantic.json"
    vertices, raw = _ply(path)
    objects = np.zeros(len(vertices), np.int64)
    with _expecting(table, "objects with id and class_name"):
        named = {int(one["id"]) + 1: str(one["class_name"]) for one in read_json(table)["objects"]}
    with _expecting(path, "faces of vertex_indices with an object_id each"):
        faces = raw["face"]["data"]
        corners = faces["vertex_indices"]["f1"].astype(np.int64)
        owner = faces["object_id"].astype(np.int64).repeat(corners.shape[1]) + 1
        keys, owners, _ = majority(corners.ravel(), owner)  # a vertex is the object's that most of its faces are
        objects[keys] = owners
    scene = (folder.resolve().parent if folder.name == "habitat" else folder.resolve()).name
    labels = {number: label for number, label in named.items() if label in CLASSES["Replica"]}
    return MeshTruth("Replica", scene, vertices, objects, labels, _REPLICA_NAMES)


def _ply(path: Path) -> tuple[NDArray, dict[str, Any]]:
    """Return the vertices of a PLY file, float64 [n, 3], and its elements as they are stored."""
    data = read_bytes(path, MAX_CLOUD_BYTES, "a mesh (.ply)")
    try:
        mesh = load_ply(io.BytesIO(data))
        return np.asarray(mesh["vertices"], np.float64).reshape(-1, 3), mesh["metadata"]["_ply_raw"]
    except Exception as error:  # trimesh raises many kinds on damaged files
        raise InputError(f"{path}: expected a mesh (.ply), found one that cannot be read ({error})") from error


@contextmanager
def _expecting(path: Path, what: str) -> Iterator[None]:
    """Raise InputError for content of another shape than expected."""
    try:
        yield
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: expected {what}, found something else ({error!r})") from error


def evaluate_mesh(simap: SIMap, folder: Path, predictions: Path | None = None) -> tuple[str, dict[str, Any]]:
    """Score a map on the mesh of a scan; returns tables as text, and everything JSON-able.

    Args:
        simap: its world frame has to be that of the scan's mesh.
        folder: the scan, as `read_truth` takes it.
        predictions: write the benchmark's submission files to a folder of its name in here.

    Raises:
        InputError: the scan cannot be read, or the predictions not written.
    """
    truths, points, instances = read_truth(folder), space_points(simap), all_instances(simap)
    at = transform_points(simap.T_map_world, truths[0].vertices)  # those of all benchmarks
    away, nearest = KDTree(points.positions).query(at) if len(points) else (np.full(len(at), np.inf), 0)
    found = np.where(away <= REACH_M, np.append(points.instances, 0)[nearest], 0).astype(np.int64)
    scores = {one.id: float(one.score) for one in instances}
    tables, rows, files = [], [], dict[Path, bytes]()
    for truth in truths:
        classes_of_map, scored = sorted({one.label for one in instances}), CLASSES[truth.benchmark]
        called = {label: label if label in scored else truth.names.get(label) for label in classes_of_map}
        found_labels = {one.id: name for one in instances if (name := called[one.label])}
        classes = average_precision(truth.objects, truth.labels, found, found_labels, scores)
        mean = _mean([*classes.values()])
        record = {label: asdict(score) for label, score in classes.items()}
        rows.append({"benchmark": truth.benchmark, "scene": truth.scene, "mean": asdict(mean), "classes": record,
                     "read_as": called})  # fmt: skip
        tables.append(_table(truth, {"mean of classes": mean, **classes}, called))
        if predictions is not None:
            files |= _prediction_files(predictions / truth.benchmark, truth, found, found_labels, scores)
    for path in files:
        path.parent.mkdir(parents=True, exist_ok=True)
    write_all(files, "the predictions")
    return "\n".join(tables), {"format": FORMAT, "task": "ap", "scan": str(folder), "rows": rows}


def _mean(scores: list[ClassScore]) -> ClassScore:
    """Return the mean over the classes that the scene has objects of, and all counts together."""
    ap, ap50, ap25 = (Measured.over([getattr(one, name) for one in scores]).mean for name in ("ap", "ap50", "ap25"))
    return ClassScore(ap, ap50, ap25, sum(one.true for one in scores), sum(one.found for one in scores))


def _table(truth: MeshTruth, scores: Mapping[str, ClassScore], called: Mapping[str, str | None]) -> str:
    read = [f"{label} as {name}" for label, name in called.items() if name and name != label]
    other = [label for label, name in called.items() if not name]
    notes = [f"{what}: {', '.join(names)}" for what, names in (("Read", read), ("Not scored", other)) if names]
    body = tuple(
        (label, *(Measured(value, 0).text(3) for value in (one.ap, one.ap50, one.ap25)), str(one.true), str(one.found))
        for label, one in scores.items()
    )
    title = f"{truth.scene}: average precision as {truth.benchmark} defines it, on {len(truth.vertices)} vertices"
    return TextTable(title, ("class", "AP", "AP50", "AP25", "true", "found"), body, note="\n".join(notes)).text()


def _prediction_files(
    folder: Path, truth: MeshTruth, found: NDArray, labels: Mapping[int, str], scores: Mapping[int, float]
) -> dict[Path, bytes]:
    """Return {path: content} of a submission: SCENE.txt, and a file for each instance with 0 or 1 for each vertex."""
    files, lines = dict[Path, bytes](), []
    for number in sorted(set(np.unique(found).tolist()) & set(labels)):
        name = f"pred_mask/{truth.scene}_{len(lines):03d}.txt"
        mask = np.where(found == number, ord("1"), ord("0")).astype(np.uint8)
        files[folder / name] = np.stack([mask, np.full_like(mask, ord("\n"))], axis=1).tobytes()
        lines.append(f"{name} {CLASSES[truth.benchmark][labels[number]]} {scores[number]:.9g}\n")
    return {**files, folder / f"{truth.scene}.txt": "".join(lines).encode()}
