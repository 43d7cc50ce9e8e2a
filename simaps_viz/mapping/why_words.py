"""Why one object, and why two, in words."""

from simaps_viz.labels import plural
from simaps_viz.mapping.simap import JOINING
from simaps_viz.mapping.why import Between, Joint, Link, Why
from simaps_viz.mapping.why_frames import Together


def score_text(method: str, score: float) -> str:
    """Say a score of the merge log as its method means it: "19.6 %" of cells (paper), "0.87" of evidence."""
    return f"{100.0 * score:.1f} %" if method == "paper" else f"{score:.2f}"


def needed_text(method: str, threshold: float) -> str:
    """Say what a score must exceed: "K = 5 %", "0.60"."""
    return f"K = {100.0 * threshold:g} %" if method == "paper" else f"{threshold:.2f}"


def summary(why: Why, *, by_hand: bool = False) -> str:
    """Say in two sentences why an instance is one object.

    Args:
        why: what the map knows.
        by_hand: people made the instance what it is; what the map would have joined does not count then.
    """
    if by_hand:
        return f"One object because people made it so by hand, see below. {_seen_as_one(why)}"
    return f"{_one_object(why)} {_weakest(why)}"


def joint_words(why: Why, joint: Joint) -> str:
    """Say on what evidence a step of the merge log joined its parts."""
    if why.method == "paper":
        return f"{score_text('paper', joint.score)} of the part that joined neighbours the other"
    return f"{_sightings(joint.same, joint.different)} → {score_text(why.method, joint.score)}"


def together_words(together: Together) -> str:
    """Say how many frames saw two parts at once, and as what."""
    one, two = len(together.as_one), len(together.as_two)
    if one + two == 0:
        return "no frame saw both"
    if one + two == 1:
        return f"seen together in 1 frame, as {'one' if one else 'two'}"
    if one == 0 or two == 0:
        return f"seen together in {one + two} frames, each time as {'one' if one else 'two'}"
    return f"seen together in {one + two} frames: as two in {two}, as one in {one}"


def link_words(method: str, threshold: float, link: Link) -> str:
    """Say what keeps two instances of a class apart: "seen together in ... → 0.11, below the 0.60 needed"."""
    seen = together_words(link.together)
    if method not in JOINING:
        touch = "their cells touch" if link.touching else "their cells do not touch"
        return f"{touch}; {seen}"
    if method == "paper":
        if link.score == 0.0:
            return f"{seen}; no cell of one neighbours a cell of the other"
        share = f"{score_text(method, link.score)} of the cells of one neighbour the other"
        return f"{seen}; {share}, {_below(method, threshold, link)}"
    if link.same + link.different == 0 and not link.touching:
        why = "no pair of their cells was compared (too far apart, or open floor between)"
        compared = "nothing speaks for one" if len(link.together) == 0 else why
        return f"{seen}; {compared} → {score_text(method, link.score)}, {_below(method, threshold, link)}"
    return f"{seen} → {score_text(method, link.score)}, {_below(method, threshold, link)}"


def between_words(found: Between, first: str, second: str) -> str:
    """Say what keeps two instances apart, in sentences.

    Args:
        found: what was found.
        first: name of the first, such as "chair 2 of 5".
        second: name of the second.
    """
    link = found.link
    if link is None:
        return (
            f"{first} and {second} are of different classes, and the map joins cells of one class only. "
            f"{together_words(found.together).capitalize()}."
        )
    apart = "touch" if link.touching else f"are {link.distance_m:.2f} m apart"
    text = f"{first} and {second} {apart}: {link_words(found.method, found.threshold, link)}."
    if found.method == "evidence" and link.same + link.different > 0:
        text += f" Pooled over all pairs of their cells: {_sightings(link.same, link.different)}."
    return text


def _one_object(why: Why) -> str:
    seen = len(why.frames)
    as_one = sum(frame.as_one for frame in why.frames)
    if seen == 0:
        return "One object because its cells belong together; no frame is known to have named it."
    if as_one == 0:
        return f"One object although none of the {plural(seen, 'frame')} that saw it saw it as one segment."
    which = f"{as_one} of the {seen} frames"
    if as_one == seen:
        which = "the 1 frame" if seen == 1 else f"all {seen} frames"
    reason = "because" if 2 * as_one > seen else "although only"
    return f"One object {reason} {which} that saw it saw most of it as one segment."


def _seen_as_one(why: Why) -> str:
    seen, as_one = len(why.frames), sum(frame.as_one for frame in why.frames)
    if seen == 0:
        return "No frame is known to have named it."
    return f"Of the {plural(seen, 'frame')} that saw it, {as_one or 'none'} saw most of it as one segment."


def _weakest(why: Why) -> str:
    if why.method not in JOINING:
        return f"Method {why.method} has no joints to question: it knows no merge log."
    if why.weakest is None:
        return "It is a single patch that was never joined from parts."
    weakest, method = why.weakest, why.method
    text = f"Its weakest joint ({weakest.target_cells} + {plural(weakest.source_cells, 'cell')}) has "
    text += f"{score_text(method, weakest.score)}, above the {needed_text(method, why.threshold)} needed: "
    if len(why.together) == 0:
        return f"{text}its parts touch, and nothing speaks against it."
    return f"{text}{together_words(why.together)}."


def _below(method: str, threshold: float, link: Link) -> str:
    needed = needed_text(method, threshold)
    return f"{'above' if link.score > threshold else 'below'} the {needed} needed"


def _sightings(same: int, different: int) -> str:
    return f"{same:,} sightings as one, {different:,} as two"
