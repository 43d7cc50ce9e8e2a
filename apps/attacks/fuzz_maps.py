"""Fuzzing targets: the map file, its edits, and the steps of a build."""

import io
import json
import struct
import zlib
from pathlib import Path
from random import Random

import numpy as np
from attacks.fuzz_cases import Case, Target
from attacks.fuzz_mutators import mutate_array, mutate_bytes, mutate_json, mutate_npy, mutate_value, mutate_zip
from build_logs import keep_log, read_log
from sequences import write_tiny_sequence
from toy_maps import TOY_POSE, toy_map

from simaps_viz import open_sequence
from simaps_viz.build.build_log import BuildLog, history_path
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.mapping.edits import delete, merge, relabel
from simaps_viz.mapping.explain import explain
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.history import MapHistory
from simaps_viz.mapping.mending import (
    EditLog,
    EditsFile,
    apply_log,
    edits_path,
    fingerprint,
    moved_to,
    read_edits,
    save_edits,
    to_bytes,
)
from simaps_viz.mapping.simap import repartition
from simaps_viz.mapping.steps import MAGIC
from simaps_viz.navigation.agent import answer
from simaps_viz.structures import SIMap


def use_map(r: Random, simap: SIMap, folder: Path) -> None:
    """Do with a map what people do; a map that was taken must stand all of it."""
    simap.counts()
    x0, y0, x1, y1 = simap.spec.extent_m
    simap.at((x0 + x1) / 2, (y0 + y1) / 2)
    if simap.instances:
        one = r.choice(simap.instances)
        explain(simap, one.id)
        answer(simap, f"robot.move_to_object({one.label!r})", TOY_POSE)
    out = folder / "out.npz"
    out.unlink(missing_ok=True)
    save_map(simap, out)
    load_map(out)
    assert not [path for path in folder.iterdir() if path.name.startswith(".out")], "a file half written"
    for name in {"paper": ("k_percent",), "evidence": ("affinity",)}.get(simap.method, ()):
        repartition(simap, **{name: r.choice((0.0, 0.5, 1.0))})


def maps(folder: Path) -> list[SIMap]:
    """Return a small map of each method."""
    sequence = open_sequence(write_tiny_sequence(folder / "tiny"))
    built = [build_map(sequence, BuildConfig(method=method)) for method in ("evidence", "paper", "components")]  # type: ignore
    return [*built, toy_map()]


def _unpacked(simap: SIMap, folder: Path) -> dict[str, np.ndarray]:
    save_map(simap, folder / "a.npz")
    with np.load(folder / "a.npz") as archive:
        return dict(archive)


def _map_file(folder: Path) -> Case:
    arrays = [_unpacked(simap, folder) for simap in maps(folder)]
    whole = []
    for one in arrays:
        buffer = io.BytesIO()
        np.savez(buffer, **one)  # type: ignore
        whole.append(buffer.getvalue())
    path = folder / "case.npz"

    def case(r: Random) -> object:
        which = r.choice((0, 0, 1, 2, 3)) if r.random() < 0.3 else r.randrange(3)
        kind = r.random()
        if kind < 0.2:
            path.write_bytes(mutate_zip(r, whole[which], lambda name: mutate_npy))
        else:
            changed = dict(arrays[which])
            for _ in range(r.choice((1, 1, 2))):
                name = "metadata" if r.random() < 0.35 else r.choice(list(changed))
                if name == "metadata":
                    text = mutate_json(r, str(arrays[which]["metadata"]).encode()).decode("utf-8", "replace")
                    changed[name] = np.array(text)
                else:
                    changed[name] = mutate_array(r, changed[name])
            with path.open("wb") as file:
                np.savez(file, **changed)  # type: ignore
        simap = load_map(path)
        if simap.spec.rows * simap.spec.cols < 1 << 16:
            use_map(r, simap, folder)
        return simap

    return case


def _metadata(folder: Path) -> Case:
    """Damage nothing but the metadata, which is quick: the arrays are those of a good map."""
    from simaps_viz.mapping import file  # noqa: PLC0415 - its inside

    good = [_unpacked(simap, folder) for simap in maps(folder)[:3]]

    def case(r: Random) -> object:
        arrays = dict(r.choice(good))
        arrays["metadata"] = np.array(mutate_json(r, str(arrays["metadata"]).encode()).decode("utf-8", "replace"))
        return file.map_in(folder / "a.npz", arrays)

    return case


def _edits(folder: Path) -> Case:
    simap = toy_map()
    log = EditLog()
    first, second = simap.of_class("chair")[:2]
    for edit in (relabel(simap, first.id, "couch"), merge(simap, first.id, second.id), delete(simap, second.id)):
        log = log.add(edit, who="Ann", when="2026-11-21T19:30:00Z")
    good = to_bytes(EditsFile(fingerprint(simap), simap.spec, log.undo()), "toy.npz")
    path = edits_path(folder / "toy.npz")

    def case(r: Random) -> object:
        path.write_bytes(mutate_json(r, good))
        contents, _ = read_edits(path)
        if r.random() < 0.1:
            apply_log(simap, moved_to(contents, simap).log)
            save_edits(folder / "out.edits.json", contents, "toy.npz")
        return contents

    return case


def _record(kind: int, content: bytes) -> bytes:
    head = bytes([kind])
    return struct.pack("<IIB", len(content), zlib.crc32(content, zlib.crc32(head)), kind) + content


def _logs(folder: Path) -> tuple[bytes, dict, list[tuple[int, bytes]]]:
    sequence = open_sequence(write_tiny_sequence(folder / "tiny"))
    log = folder / "log"
    build_map(sequence, BuildConfig(), log=log)
    known, records = read_log(log)
    return log.read_bytes(), known, records


def _damaged(r: Random, whole: bytes, known: dict, records: list[tuple[int, bytes]]) -> bytes:
    """Damage the file, or what is in its records, whose checksums are then right again."""
    if r.random() < 0.2:
        return mutate_bytes(r, whole)
    parts = [(kind, content) for kind, content in records]
    facts = json.dumps(known).encode()
    which = r.randrange(len(parts) + 1)
    if which == len(parts):
        facts = json.dumps(mutate_value(r, json.loads(facts)), ensure_ascii=True).encode()
    else:
        kind, content = parts[which]
        index, length = struct.unpack_from("<iI", content)
        about = content[8 : 8 + length]
        if r.random() < 0.5:
            about = mutate_json(r, about)
            content = struct.pack("<iI", index, len(about)) + about + content[8 + length :]
        else:
            content = content[: 8 + length] + mutate_bytes(r, content[8 + length :])
        parts[which] = r.choice(((kind, content), (2, zlib.compress(content)), (2, content), (kind, content)))
    if r.random() < 0.1:
        r.shuffle(parts)
    return MAGIC + _record(0, facts) + b"".join(_record(kind, content) for kind, content in parts)


def _history(folder: Path) -> Case:
    whole, known, records = _logs(folder)
    path = history_path(folder / "a.npz")

    def case(r: Random) -> object:
        path.write_bytes(_damaged(r, whole, known, records))
        history = MapHistory.open(path)
        if r.random() < 0.3:
            history.map_at(len(history) - 1)
        return history

    return case


def _resume(folder: Path) -> Case:
    """Resume from a damaged log: a build either succeeds, or is refused with a reason."""
    whole, known, records = _logs(folder)
    sequence = open_sequence(folder / "tiny")
    path = folder / "case"

    def case(r: Random) -> object:
        path.write_bytes(_damaged(r, whole, known, records))
        if r.random() < 0.1:
            return build_map(sequence, BuildConfig(), log=path, resume=True)
        with BuildLog(path, known, resume=True) as log:
            steps = list(log.replay())
        if r.random() < 0.1:
            keep_log(path, folder / "kept.steps")
        return steps

    return case


MAP_TARGETS = (
    Target("map file", _map_file, weight=60, guided=True),
    Target("map metadata", _metadata, weight=60, guided=True),
    Target("edits", _edits, weight=60, guided=True),
    Target("build log: history", _history, weight=20, guided=True),
    Target("build log: resume", _resume, weight=20, guided=True),
)
