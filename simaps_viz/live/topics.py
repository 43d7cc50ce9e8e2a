"""Which topics of a robot a map is made of, found by type and name."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from itertools import takewhile
from typing import Any

from simaps_viz.errors import InputError

ODOMETRY, STRING = "nav_msgs/msg/Odometry", "std_msgs/msg/String"
MASK_WORDS = ("mask", "panoptic", "instance", "segment")
NO_COLOR = ("depth", "infra", "confidence", "disparity", *MASK_WORDS)


@dataclass(frozen=True)
class TopicNames:
    """The topics of a robot; those that are not named are found by type and name. Options of a command, too."""

    color_topic: str = ""
    """Colour images; only a network looks at them."""
    depth_topic: str = ""
    """Depth images, 16UC1 millimetres or 32FC1 metres, also compressed."""
    info_topic: str = ""
    """CameraInfo of the depth images."""
    masks_topic: str = ""
    """Images of instance ids, mono16 or 32SC1, with the stamps of the depth images; "-" = none."""
    labels_topic: str = ""
    """std_msgs/String with JSON: {"<id>": {"label": "chair", "score": 0.9}}; "-" = none."""


@dataclass(frozen=True)
class Chosen:
    """The topics that are used; "" = there is none."""

    color: str
    depth: str
    info: str
    masks: str
    labels: str
    poses: tuple[str, ...]
    """/tf and /tf_static, or Odometry where there is no tf."""

    @property
    def all(self) -> tuple[str, ...]:
        """Return all of them, once each."""
        return tuple(self.uses())

    def uses(self) -> dict[str, str]:
        """Return {topic: what it is used for}."""
        found = {getattr(self, use): use for use in ("color", "depth", "info", "masks", "labels")}
        return {topic: use for topic, use in found.items() if topic} | dict.fromkeys(self.poses, "poses")


def choose_topics(offered: Mapping[str, str], named: TopicNames, *, color: bool) -> Chosen:
    """Choose among the topics that a robot offers, {name: type}.

    Args:
        offered: by the robot.
        named: by a person; they are taken as they are.
        color: colour is needed, as a network has to look at it.

    Raises:
        InputError: something is missing or unclear; the message names the option that decides.
    """
    # Imported here, as the command line reads its options before numpy is there.
    from simaps_viz.datasets.ros_messages import CAMERA_INFO, COMPRESSED, IMAGE, TF_TYPES  # noqa: PLC0415

    for field in fields(named):
        topic = getattr(named, field.name)
        if topic not in ("", "-") and topic not in offered:
            option = field.name.replace("_", "-")
            raise InputError(f"--{option} {topic}: expected a topic of the robot, found {_list(offered)}")
    pictures = [t for t, kind in offered.items() if kind in (IMAGE, COMPRESSED)]
    depths = [t for t in pictures if _has(t, "depth") and not _has(t, *MASK_WORDS, "confidence")]
    depth = named.depth_topic or _one(
        "depth", depths, lambda t: (not _has(t, "aligned", "registered"), offered[t] == COMPRESSED)
    )
    if not depth:
        raise InputError(f"--depth-topic: expected a topic with depth images, found none among {_list(offered)}")
    colors = [t for t in pictures if not _has(t, *NO_COLOR)]
    near = lambda t: (not _has(t, "color", "rgb"), -len(_shared(t, depth)), offered[t] != COMPRESSED)  # noqa: E731
    chosen_color = named.color_topic or (_one("color", colors, near) if color else "")
    if color and not chosen_color:
        raise InputError(f"--color-topic: expected a topic with colour images, found none among {_list(offered)}")
    infos = [t for t, kind in offered.items() if kind == CAMERA_INFO]
    info = named.info_topic or _one("info", infos, lambda t: -len(_shared(t, depth)))
    if not info:
        raise InputError(f"--info-topic: expected the depth camera's CameraInfo, found none among {_list(offered)}")
    masks = [t for t in pictures if _has(t, *MASK_WORDS) and offered[t] == IMAGE]
    labels = [t for t, kind in offered.items() if kind == STRING and _has(t, "label")]
    masks_topic = "" if named.masks_topic == "-" else named.masks_topic or _one("masks", masks, lambda t: 0)
    labels_topic = "" if named.labels_topic == "-" else named.labels_topic or _one("labels", labels, lambda t: 0)
    if bool(masks_topic) != bool(labels_topic):
        missing = "labels" if masks_topic else "masks"
        if named.masks_topic or named.labels_topic:
            raise InputError(
                f"--{missing}-topic: expected one that goes with {masks_topic or labels_topic}, found none"
            )
        masks_topic = labels_topic = ""
    tf = [t for t, kind in offered.items() if kind in TF_TYPES and t.rpartition("/")[2] in ("tf", "tf_static")]
    odometry = [t for t, kind in offered.items() if kind == ODOMETRY]
    poses = tf if any(t.endswith("tf") for t in tf) else [*tf, _one("odometry", odometry, lambda t: 0)]
    if not any(poses):
        raise InputError(f"expected /tf or Odometry, found neither among {_list(offered)}")
    return Chosen(chosen_color, depth, info, masks_topic, labels_topic, tuple(filter(None, poses)))


def _one(what: str, topics: list[str], rank: Callable[[str], Any]) -> str:
    """Return the topic of the lowest rank; "" where there is none.

    Raises:
        InputError: several are as good.
    """
    if not topics:
        return ""
    best = min(rank(topic) for topic in topics)
    found = sorted(topic for topic in topics if rank(topic) == best)
    if len(found) > 1:
        raise InputError(f"--{what}-topic: expected one topic, found {', '.join(found)}: name the one that is meant")
    return found[0]


def _has(topic: str, *parts: str) -> bool:
    return any(part in topic.lower() for part in parts)


def _shared(one: str, other: str) -> list[str]:
    """Return the leading parts that two names share."""
    pairs = zip(one.strip("/").split("/"), other.strip("/").split("/"), strict=False)
    return [part for part, _ in takewhile(lambda pair: pair[0] == pair[1], pairs)]


def _list(offered: Iterable[str]) -> str:
    return ", ".join(sorted(offered)[:40]) or "no topics"
