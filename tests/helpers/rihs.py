"""RIHS01 hashes of services and actions, which rosbags does not make, from the text of their definitions.

A service is hashed as the type of its request, response and event; an action's goals and results are such services.
"""

import json
from hashlib import sha256
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

from simaps_viz.live.links import message_types

NUMBERS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9, "float32": 10,
    "float64": 11, "char": 3, "bool": 15, "byte": 16, "octet": 16, "string": 17,
}  # fmt: skip


class Definitions:
    """Types by name, to which services and actions are added; each addition returns hashes."""

    def __init__(self) -> None:
        """Begin with the messages of ROS."""
        self._fields: dict[str, Any] = {name: found[1] for name, found in message_types().fielddefs.items()}

    def message(self, name: str, text: str) -> str:
        """Add a message, or a part of an action."""
        self._fields[name] = get_types_from_msg(text, "a/msg/A")["a/msg/A"][1]
        return self._hash(name)

    def service(self, name: str, request: str, response: str) -> str:
        """Add a service."""
        self.message(f"{name}_Request", request)
        self.message(f"{name}_Response", response)
        named = {part: (Nodetype.NAME, f"{name}_{part}") for part in ("Request", "Response", "Event")}
        one = {part: (Nodetype.SEQUENCE, (kind, 1)) for part, kind in named.items()}
        info = ("info", (Nodetype.NAME, "service_msgs/msg/ServiceEventInfo"))
        self._fields[f"{name}_Event"] = [info, ("request", one["Request"]), ("response", one["Response"])]
        self._fields[name] = [(f"{part.lower()}_message", kind) for part, kind in named.items()]
        return self._hash(name)

    def action(self, name: str, goal: str, result: str, feedback: str) -> tuple[str, str, str]:
        """Add an action; return the hashes of SendGoal, GetResult and FeedbackMessage."""
        for part, text in {"Goal": goal, "Result": result, "Feedback": feedback}.items():
            self.message(f"{name}_{part}", text)
        uuid = "unique_identifier_msgs/UUID goal_id\n"
        self.service(f"{name}_SendGoal", uuid, "bool accepted\nbuiltin_interfaces/Time stamp")
        self._fields[f"{name}_SendGoal_Request"].append(("goal", (Nodetype.NAME, f"{name}_Goal")))
        send = self._hash(f"{name}_SendGoal")
        self.service(f"{name}_GetResult", uuid, "int8 status")
        self._fields[f"{name}_GetResult_Response"].append(("result", (Nodetype.NAME, f"{name}_Result")))
        self.message(f"{name}_FeedbackMessage", uuid)
        self._fields[f"{name}_FeedbackMessage"].append(("feedback", (Nodetype.NAME, f"{name}_Feedback")))
        return send, self._hash(f"{name}_GetResult"), self._hash(f"{name}_FeedbackMessage")

    def _hash(self, name: str) -> str:
        found: dict[str, Any] = {}
        self._collect(name, found)
        others = [one for key, one in sorted(found.items()) if key != name]
        text = json.dumps({"type_description": found[name], "referenced_type_descriptions": others})
        return f"RIHS01_{sha256(text.encode()).hexdigest()}"

    def _collect(self, name: str, found: dict[str, Any]) -> None:
        if name in found:
            return
        empty: Any = [("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))]
        found[name] = {"type_name": name, "fields": [_field(*one) for one in self._fields[name] or empty]}
        for one in found[name]["fields"]:
            if one["type"]["nested_type_name"]:
                self._collect(one["type"]["nested_type_name"], found)


def _field(name: str, kind: Any) -> dict[str, Any]:
    many, capacity = 0, 0
    if kind[0] == Nodetype.ARRAY:
        many, (kind, capacity) = 48, kind[1]
    elif kind[0] == Nodetype.SEQUENCE:
        kind, capacity = kind[1]
        many = 96 if capacity else 144
    number = 1 if kind[0] == Nodetype.NAME else NUMBERS[kind[1][0]]
    nested = kind[1] if kind[0] == Nodetype.NAME else ""
    about = {"type_id": many + number, "capacity": capacity, "string_capacity": 0, "nested_type_name": nested}
    return {"name": name, "type": about}
