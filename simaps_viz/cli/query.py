"""`simaps query`: commands and questions in English or as programs, carried out and answered by a simulated robot."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from simaps_viz.cli import NO, OK
from simaps_viz.errors import InputError


@dataclass(frozen=True)
class Query:
    """Ask or command a simulated robot on a map, in English or by programs; print its answers.

    Example: simaps query cafe.npz "go to the third chair" "how many tables are there?" --pose 1.5 2 90 --json
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz)."""
    command: tyro.conf.Positional[tuple[str, ...]]
    """One or more commands or questions, each from the given pose."""
    pose: tuple[float, float, float] | None = None
    """Where the robot starts: x and y in metres, heading in degrees clockwise from north. By default where the first
    camera stood that has free floor by it."""
    llm: str | None = None
    """Let a language model read the commands: MODEL, or MODEL@ADDRESS of a chat-completions server, such as
    qwen2.5:7b@http://127.0.0.1:11434/v1. The key comes from OPENAI_API_KEY. Without it, an offline grammar reads."""
    edits: bool = True
    """Ask the map with the edits made by hand (MAP.edits.json)."""
    json: bool = False
    """Print one JSON line a command."""

    def run(self) -> int:
        """Print an answer to each command; the answer is no when one of them failed."""
        from simaps_viz.app import workbench
        from simaps_viz.console.terminal import emit
        from simaps_viz.mapping.mending import load_mended
        from simaps_viz.navigation.agent import answer, start_pose
        from simaps_viz.structures import Pose2

        if not self.command:
            raise InputError('query: expected at least one command, for example "go to the second chair", found none')
        simap = load_mended(self.map, edits=self.edits)
        pose = Pose2.from_heading(*self.pose) if self.pose else start_pose(simap)
        reader = workbench.reader(self.llm, simap, pose)
        good = True
        for text in self.command:
            result = answer(simap, text, pose, reader=reader)
            good = good and result.status == "ok"
            record = {"command": text, **result.to_json()}
            if self.json:
                emit(record)
            else:
                _print_answer(record)
        return OK if good else NO


def _print_answer(record: dict[str, Any]) -> None:
    from simaps_viz.console.terminal import say

    lines = [f"> {record['command']}", *(f"    {line}" for line in (record["program"] or "").strip().splitlines())]
    if "answer" in record:
        lines.append(record["answer"]["text"])
    if record["status"] != "ok":
        lines.append(f"{record['status']}: {record['reason']}")
    elif "answer" not in record or record["path_length_m"] > 0.0:
        x, y, heading = record["final_pose"]
        lines.append(f"ok: drove {record['path_length_m']:.2f} m to x {x:.2f} m, y {y:.2f} m, heading {heading:.0f}°")
    say("\n".join(lines) + "\n")
