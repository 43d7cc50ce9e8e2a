"""Commands as people say them, and what they should come to: expectations are worked out by ``world.World``.

Each entry is a map and pose (``toy``, or a room of the rendered house), what should happen, and ways to
say it, between slashes.
"""

from typing import Final

import numpy as np
from world import End, Expected, World


def goes(*numbers) -> Expected:
    """Goals with these instances; each given as a number or a function of the world."""
    return lambda w: End(goals=[n if isinstance(n, int) else n(w) for n in numbers])


def nth(label: str, n: int = 1) -> Expected:
    return lambda w: End(goals=[w.nth(label, n)])


def side(label: str, way: str, n: int = 1) -> Expected:
    return lambda w: End(goals=[w.side(label, way, n)])


def near(label: str, other: str, n: int = 1, which: int = 1) -> Expected:
    return lambda w: End(goals=[w.near(label, w.nth(other, which), n)])


def turned(degrees: float) -> Expected:
    return lambda w: End(heading_deg=w.pose.heading_deg + degrees, position=(w.pose.x_m, w.pose.y_m))


def heads(degrees: float) -> Expected:
    return lambda w: End(heading_deg=degrees, position=(w.pose.x_m, w.pose.y_m))


def moved(ahead_m: float, degrees: float = 0.0, turned_by: float | None = None) -> Expected:
    """Driven that far towards a heading relative to the first one; then looks ``turned_by`` from the first heading."""

    def end(w: World) -> End:
        way = np.deg2rad(w.pose.heading_deg + degrees)
        there = (w.pose.x_m + ahead_m * float(np.sin(way)), w.pose.y_m + ahead_m * float(np.cos(way)))
        final = degrees if turned_by is None else turned_by
        return End(position=there, near_m=0.01, heading_deg=w.pose.heading_deg + final)

    return end


def looks(label: str, n: int = 1, off: float = 0.0) -> Expected:
    def end(w: World) -> End:
        x, y = w.middle(w.nth(label, n)) - (w.pose.x_m, w.pose.y_m)
        return End(goals=[w.nth(label, n)], heading_deg=float(np.rad2deg(np.arctan2(x, y))) + off)

    return end


def beside(label: str, way: str, n: int = 1) -> Expected:
    """Ends on a side of a thing: a compass word, or left, right, front, behind as seen from the pose."""

    def end(w: World) -> End:
        number = w.nth(label, n)
        x, y = w.middle(number) - (w.pose.x_m, w.pose.y_m)
        compass = {"north": (0, 1), "south": (0, -1), "east": (1, 0), "west": (-1, 0)}
        ways = {**compass, "left": (-y, x), "right": (y, -x)}
        return End(goals=[number], side_of=(number, np.array(ways[way], float)))

    return end


def refused(*words: str) -> Expected:
    return lambda _: End(refused=words)


def told(value: object) -> Expected:
    """A question is answered and the robot stays."""
    return lambda w: End(told=value, position=(w.pose.x_m, w.pose.y_m))


def all_of(*labels: str) -> Expected:
    return lambda w: End(goals=w.ranked(*labels))


HOME: Final[Expected] = lambda w: End(position=(w.pose.x_m, w.pose.y_m))  # noqa: E731
STAYS: Final[Expected] = turned(0.0)

# fmt: off
CORPUS: Final[list[tuple[str, Expected, str]]] = [
    # ---- ranks from where the command is given
    ("toy", nth("chair", 1),
        "go to the chair / go to the nearest chair / robot, drive to the closest chair please / could you head "
        "over to the nearest chair / I'd like you to approach a chair / walk up to the first chair / the chair "
        "closest to you / move to the chair that is nearest to you / get next to the closest chair"),
    ("toy", nth("chair", 2),
        "go to the second chair / go to the 2nd chair / navigate to the second-closest chair / "
        "please visit the second nearest chair / drive to the chair "
        "second closest to you / proceed to the second to last chair"),
    ("toy", nth("chair", 3),
        "go to the third chair / I want you to go to the 3rd chair from here / take me to the third "
        "nearest chair / go to the last chair / go to the farthest chair / go to the chair furthest from you / "
        "run to the most distant chair / the chair that is the farthest away / find the chair which is farthest "
        "from here / third closest chair"),
    ("house", nth("chair", 4), "go to the fourth chair / kindly drive to the 4th nearest chair"),
    ("house", nth("chair", -2),
        "go to the second farthest chair / go to the penultimate chair / go to the second last chair"),
    ("bedroom", nth("nightstand", 2),
        "go to the other nightstand / go to the second bedside table / go to the nightstand farthest from you"),
    # ---- sides
    ("toy", side("chair", "left"),
        "go to the leftmost chair / go to the left-most chair / go to the chair on the left / go to the first "
        "chair from the left / drive to the chair furthest to the left / the left chair / approach the chair on "
        "the far left / go to the most left chair"),
    ("toy", side("chair", "left", 2),
        "go to the second chair from the left / go to the second leftmost chair / the chair second from the left "
        "/ go to the 2nd chair counting from the left / go to the second chair from your left"),
    ("toy", side("chair", "right"),
        "go to the rightmost chair / go to the right-hand chair / go to the last chair from the left / go to the "
        "chair that is on the right / the chair at the right end"),
    ("house", side("chair", "left", 3), "go to the third chair from the left / the chair third from the left please"),
    ("house", side("chair", "north"),
        "go to the northernmost chair / go to the most northerly chair / go to the chair furthest north / go to "
        "the chair farthest to the north"),
    ("house", side("chair", "west"),
        "go to the westernmost chair / go to the first chair from the west / head for the most western chair"),
    ("house", side("chair", "east", 2), "go to the second chair from the east / go to the second easternmost chair"),
    ("house", side("trash can", "west"), "go to the westernmost bin / go to the most westerly garbage can"),
    # ---- neighbours
    ("toy", near("chair", "couch"),
        "go to the chair nearest the couch / go to the chair closest to the sofa / go to the chair next to the "
        "settee / drive to the chair beside the couch / the chair by the couch / go to the closest chair to the "
        "couch / go to the chair that's near the couch / stop at the chair near the sofa"),
    ("toy", near("chair", "dining table", which=2),
        "go to the chair near the second table / go to the chair nearest the second closest table / go to the "
        "chair close to the last table"),
    ("toy", lambda w: End(goals=[w.near("chair", w.side("dining table", "right"))]),
        "go to the chair next to the rightmost table / go to the chair closest to the second table from the left"),
    ("house", near("chair", "desk"),
        "go to the chair at the desk / go to the desk chair / I need you to go to the chair closest to the desk"),
    ("house", near("chair", "tv", which=2), "go to the chair nearest to the second tv"),
    ("house", near("trash can", "bed"), "go to the bin near the bed / go to the trash can closest to the bed"),
    ("house", lambda w: End(goals=[w.far_from("chair", w.nth("desk"))]),
        "go to the chair farthest from the desk / drive to the chair that is most distant from the desk"),
    ("house", lambda w: End(goals=[w.near("chair", w.near("trash can", w.nth("bed")))]),
        "go to the chair near the trash can near the bed / go to the chair closest to the bin beside the bed"),
    ("dining", near("chair", "window", 2, which=1),
        "go to the second chair nearest the window / go to the second closest chair to the window / the chair "
        "second nearest to the window"),
    ("house", goes(lambda w: w.near("tv", w.nth("bed"))),
        "go to the telly closest to the bed / approach the television near the bed"),
    ("house", refused("no lamp within 3 m of the couch"), "look at the lamp above the sofa"),
    ("bedroom", goes(lambda w: w.beside("nightstand", w.nth("bed"), "left")),
        "go to the nightstand left of the bed / go to the nightstand to the left of the bed / the bedside table "
        "on the left of the bed / go to the nightstand on the left side of the bed"),
    ("bedroom", goes(lambda w: w.beside("nightstand", w.nth("bed"), "right")),
        "go to the nightstand right of the bed / go to the night stand on the right hand side of the bed"),
    ("house", goes(lambda w: w.beside("chair", w.nth("dining table"), "north")),
        "go to the chair north of the dining table / go to the chair on the north side of the dining table"),
    # ---- between
    ("toy", goes(1),
        "go to the chair between the table and the couch / go to the chair that stands between the sofa and the "
        "table"),
    ("toy", goes(4), "go to the chair between the second table and the plant"),
    ("house", nth("table"), "go to the table between the chairs / go to the table between the two closest chairs"),
    ("toy", goes(5),
        "go between the couch and the plant / stand in the middle of the couch and the plant / drive in between "
        "the sofa and the plant / stop halfway between the couch and the plant"),
    ("toy", lambda w: End(goals=[6]),
        "go between the two tables / position yourself between the tables / go between both tables / go between "
        "the first and the second table"),
    ("house", lambda w: End(goals=[w.nth("bed")]),
        "go between the bed and the wardrobe / move to the spot between the bed and the wardrobe"),
    # ---- in view
    ("toy", goes(4),
        "go to the chair in view / go to the chair you can see / go to a chair that you see / go to the first "
        "chair in your field of view / approach the nearest visible chair / the chair in front of you / go to "
        "the nearest of the chairs in view / go to the leftmost chair in view"),
    ("toy", refused("only 1 chair", "in view"),
        "go to the second chair in view / go to the second visible chair / go to the fourth chair in your field "
        "of view / go to the 2nd of the chairs you can see"),
    ("toy", refused("no couch", "in view"), "go to the couch in view / visit every couch in view"),
    ("dining", nth("chair", 3),
        "go to the third chair in view / go to the third chair you can see / go to the 3rd closest chair in your "
        "field of view / the third of the chairs in view"),
    ("dining", nth("chair"), "go to the chair closest to you in view"),
    ("dining", nth("chair", 4), "go to the farthest chair in view / go to the fourth visible chair"),
    ("dining", lambda w: End(goals=[max(w.ranked("chair")[:4], key=lambda i: w.middle(i)[1])]),
        "go to the leftmost chair in view / go to the first chair from the left that you can see"),
    ("dining", lambda w: End(goals=w.ranked("chair")[:4]),
        "visit every chair in view / go to each of the chairs you can see / go to all the chairs in your field "
        "of view"),
    ("dining", lambda w: End(goals=w.ranked("chair")[:3]),
        "visit the three nearest chairs in view / go to the first three chairs you can see"),
    ("bedroom", nth("nightstand", 1), "go to the nearest nightstand in view"),
    # ---- beside
    ("toy", beside("couch", "left"),
        "go to the left of the couch / go to the left side of the sofa / stand on the left of the couch / go to "
        "the couch's left side / drive left of the couch"),
    ("toy", beside("potted plant", "right"),
        "go to the right of the plant / move to the right hand side of the potted plant"),
    ("toy", beside("dining table", "north"),
        "go north of the table / go to the north side of the dining table / stop to the north of the table"),
    ("toy", beside("couch", "south"), "stand south of the couch / go to the southern side of the sofa"),
    ("toy", beside("chair", "right", 2), "move to the right of the second chair"),
    ("house", beside("coffee table", "east"),
        "go to the east of the coffee table / drive to the eastern side of the coffee table"),
    ("bedroom", beside("bed", "left"), "move to the left side of the bed"),
    ("toy", beside("dining table", "east", 1), "go east of the table"),
    ("bedroom", beside("bed", "south"), "go in front of the bed / stand in front of the bed"),
    ("house", beside("coffee table", "south"), "go behind the coffee table / drive past the coffee table"),
    # measured from the edge; the table there leaves a little less room
    ("toy", lambda w: End(goals=[5], position=(w.middle(5)[0], w.cells(5)[:, 1].min() - 1.5), near_m=0.15),
        "go 1.5 metres south of the couch / go one and a half metres to the south of the sofa"),
    # ---- turning
    ("toy", turned(-90.0),
        "turn left / make a left turn / take a left / turn 90 degrees to the left / turn to the left / do a "
        "quarter turn to the left / look left / rotate counterclockwise by ninety degrees / left"),
    ("toy", turned(90.0),
        "turn right / hang a right / turn clockwise 90° / rotate to your right / quarter turn right"),
    ("toy", turned(45.0),
        "turn right 45 degrees / turn 45 degrees right / rotate clockwise by forty five degrees / turn 45 "
        "degrees clockwise"),
    ("toy", turned(180.0),
        "turn around / do a U-turn / make a half turn / turn 180 degrees / do an about-face / turn left twice / "
        "face the other way / look behind you / do a 180"),
    ("toy", turned(0.0), "do a full circle / make a full turn / turn 360 degrees / spin around"),
    ("toy", heads(0.0), "face north / turn to the north / look north / turn to face north"),
    ("toy", heads(225.0), "turn to the south-west / face southwest / look south west"),
    ("toy", heads(135.0), "turn to heading 135 degrees / face a heading of 135 degrees / face southeast"),
    ("toy", looks("couch"),
        "face the sofa / look at the couch / turn towards the settee / turn to face the couch / point yourself "
        "at the couch / rotate until you face the couch"),
    ("toy", looks("chair", 2),
        "face the second chair / turn to the second chair / look towards the 2nd closest chair"),
    ("house", looks("tv"), "look at the tv / face the telly / turn towards the television / watch the screen"),
    ("toy", looks("dining table", 1, 90.0),
        "keep the table on your left / turn so that the table is on your left / put the table on your left hand "
        "side / make sure the table is on your left"),
    ("toy", looks("couch", 1, -90.0),
        "keep the couch to your right / turn with the couch on your right / have the sofa on your right side"),
    # ---- driving without a goal
    ("toy", moved(1.0),
        "go forward 1 m / move one metre forward / go straight ahead for 1 meter / advance 100 cm / drive 1m / "
        "go forward / walk forward a metre / proceed straight 1 metre"),
    ("toy", moved(0.5),
        "drive half a metre forward / move 50 centimetres ahead / move forward half a meter / go 0.5 m forward / "
        "go forward a bit"),
    ("toy", moved(0.9144), "go forward 3 feet / move one yard forward / move ahead 36 inches"),
    ("toy", moved(1.4), "take two steps forward / go a couple of steps ahead / walk two steps"),
    ("toy", moved(2.5), "go two and a half metres forward / go 2.5 m straight on / move 250 cm ahead"),
    ("toy", moved(-0.5), "move back 50 cm / back up half a metre / reverse 0.5 m / go backwards half a metre"),
    ("toy", moved(-1.0), "back up / move backwards / drive a meter back"),
    ("toy", moved(1.0, 90.0),
        "go 1 m to the right / turn right and go forward 1 m / move right by a metre / go south 1 m / head south "
        "for one metre / go 1 metre south"),
    ("toy", moved(0.7, -90.0), "step to the left / take a step to the left"),
    ("toy", moved(0.5, 90.0, 0.0), "sidestep 50 cm to the right"),
    ("toy", lambda w: End(position=(1.5, -0.5)),
        "go to position 1.5, -0.5 / drive to 1.5 -0.5 / go to the coordinates 1.5, -0.5"),
    # ---- sequences
    # ranks count from where the robot is by then: at the couch, the other table is the second
    ("toy", goes(5, 6),
        "go to the couch, then to the second table / first visit the sofa and then the second table / go to the "
        "couch. After that, go to the second table. / head to the couch and, when you get there, go to table 6 / "
        "after visiting the couch go to the second table"),
    ("toy", goes(6, 5, 9),
        "go to the table, the couch and the plant / visit the table, then the couch, finally the plant / go to "
        "the table; go to the couch; go to the plant / go to the table and the couch and then the plant"),
    ("toy", goes(5, 5),
        "go to the couch and face it / approach the couch, then look at it / go to the couch then turn towards "
        "it"),
    ("toy", goes(3, 1),
        "go to a chair, then the other chair / go to the nearest chair and then to the second one / go to the "
        "first and the second chair / visit chair 3 and chair 1"),
    ("toy", goes(6, 1), "go to the table and then to the chair nearest it"),
    ("toy", lambda w: End(goals=[5], position=(0.5, 0.5)),
        "go to the couch and come back / go to the sofa, then return to the start / visit the couch and go back "
        "to where you started / go to the couch and then return home / drive to the couch, afterwards come back "
        "to your starting point / go to the sofa and come back here"),
    ("toy", moved(1.0, 0.0, 90.0), "go forward 1 m and turn right / move ahead one metre, then turn right"),
    ("toy", lambda w: End(goals=[5], heading_deg=w.pose.heading_deg), "face the sofa then face east"),
    # ---- loops
    ("toy", all_of("chair"),
        "visit every chair / go to each chair / go to all the chairs / visit all of the chairs / go to every "
        "single chair / visit the chairs one by one / visit all three chairs / tour the chairs"),
    ("house", all_of("trash can"),
        "visit every trash can / go to both bins / visit both trash cans / go to all the garbage cans / visit "
        "each of the two bins"),
    ("toy", lambda w: End(goals=w.ranked("chair")[:2]),
        "visit the two nearest chairs / go to the two closest chairs / visit the nearest two chairs / go to the "
        "first two chairs"),
    ("toy", lambda w: End(goals=[w.side("chair", "left", n) for n in (1, 2)]), "visit the two leftmost chairs"),
    ("toy", lambda w: End(goals=[w.side("chair", "left", n) for n in (1, 2, 3)]),
        "visit the chairs from left to right"),
    ("toy", goes(3, 3, 1, 1, 4, 4), "visit every chair and face it / go to each chair and look at it"),
    ("toy", lambda w: End(goals=w.ranked("chair"), position=(0.5, 0.5)),
        "visit all the chairs and come back / go to every chair, then return to the start"),
    ("house", lambda w: End(goals=w.around("chair", w.nth("dining table"), 2.0)),
        "visit the chairs around the dining table / go to every chair near the dining table"),
    ("toy", all_of("dining table"), "face each table / look at all the tables"),
    # ---- open-set words
    ("house", nth("couch"), "go to the sofa / go to the loveseat / go to the cuoch / settee please"),
    ("house", nth("refrigerator"), "go to the fridge / drive to the refridgerator / go to the freezer"),
    ("house", nth("coffee table"), "go to the cofee table / go to the coffe table / drive to the coffee tabel"),
    ("house", nth("stove"), "go to the cooker / go to the hob"),
    ("house", nth("wardrobe"), "go to the closet / go to the wardrob"),
    ("house", nth("bed"), "find me a place to sleep / go somewhere to lie down / I want to go to bed"),
    ("house", nth("dining table"), "go to something to eat on / find a place to have dinner"),
    ("house", lambda w: End(goals=w.ranked("chair", "couch")[:1]),
        "find me somewhere to sit / go to the nearest seat / I need a place to sit down / go to something to sit "
        "on / I want to sit down"),
    ("house", lambda w: End(goals=[w.ranked("chair", "couch")[2]]), "go to the third nearest seat"),
    ("house", lambda w: End(goals=w.ranked("chair", "couch")), "visit all the seats"),
    ("house", lambda w: End(goals=[w.ranked("table", "dining table", "coffee table")[2]]),
        "go to the third table / go to the third closest table"),
    ("house", lambda w: End(goals=w.ids("coffee table")), "go to the table nearest the couch"),
    ("house", nth("cabinet"), "go to the cupboard / go to the sideboard"),
    ("house", nth("sports ball"), "go to the ball / find the football"),
    ("house", nth("exercise bench"), "go to the bench / go to the weight bench"),
    ("house", nth("trash can"), "go to somewhere to throw away trash / take me to the dustbin"),
    ("toy", nth("chair", 2), "go to the second chiar / go to teh second chair"),
    ("toy", turned(-90.0), "trun left"),
    ("toy", goes(4), "chair 4 / go to chair number four / head to chair #4 / go to the chair numbered 4"),
    # ---- refusals
    ("toy", refused("There is no chair 2"), "go to chair 2 / chair number two / chair 6"),
    ("toy", refused("no piano"), "go to the piano / drive to the second piano"),
    ("toy", refused("no fridge"), "go to the fridge"),
    ("toy", refused("only 3 chairs"), "go to the fourth chair / go to the seventh chair from the left"),
    ("toy", refused("only 1 couch"), "go to the second couch / visit the two couches / go between the couches"),
    ("toy", refused("no kitchen"), "go to the kitchen / enter the kitchen"),
    ("toy", refused("Not understood", "Try"),
        "make coffee / pick up the cup / open the door / sing a song / clean the table / bring me a cup of tea / "
        "follow me / what is the time / throw the ball / "
        "asdf qwerty"),
    ("toy", refused("Not understood", "not what to leave out"),
        "don't go to the chair / never go to the couch / go without touching the table"),
    ("toy", goes(6, 5),
        "before going to the couch, go to the table / go to the table before you go to the couch"),
    ("toy", refused("colours"), "go to the big red chair"),
    ("toy", told(3), "how many chairs are there?"),
    ("toy", STAYS, "stop / halt / wait / stand still / do nothing / stay where you are / wait here"),
]
# fmt: on
