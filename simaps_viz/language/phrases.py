"""The words of the grammar: what a person may say for each of its tokens, and what may be left out."""

from typing import Final

_SPOKEN: Final[dict[str, str]] = {
    "AFTER": "after, once, having",
    "AND": "and, adn, plus, &",
    "APPROACH": "explore, examine, approach, approaching, reach, reaching, visit, visiting, find, find me, locate, "
    "seek, seek out, look for, search for, show me, check, check out, inspect, tour, patrol, meet, view, show, point "
    "out, enter, go into, go inside, come into, drive into",
    "AROUND": "around, round, all around, all the way around, all the way round",
    "AT": "at, belonging to, in, inside, against, onto, on top of, above, over, under, underneath, below, beneath, "
    "atop",
    "AWAY": "away, off",
    "BACK": "back",
    "BACKUP": "back up, reverse, back off, back away, backing up, reversing",
    "BACKWARD": "backward, backwards, rearward, rearwards, in reverse",
    "BEFORE": "before, beforehand",
    "BEHIND": "behind, in back of, at the back of, beyond, on the far side of, on the other side of, to the far "
    "side of, to the other side of, to the back of, the far side of, the other side of, the back of, round the back "
    "of, around the back of, behind of",
    "BETWEEN": "between, in between, inbetween, in the middle of, in the middle between, halfway between, midway "
    "between, the middle between, the midpoint between, the midpoint of, the point between, the gap between, the "
    "space between, the middle of, the centre of, the center of, in the centre of, in the center of, amid, the place "
    "between, the spot between, center of, centre of, middle of, half way between, the area between",
    "BOTH": "both",
    "BY": "by, by about, about, roughly, approximately, by another, for another, by exactly, by roughly, for about",
    "CENTIMETRES": "cm, cms, centimeter, centimeters, centimetre, centimetres",
    "CIRCLE": "circle, circle around, circle round, orbit, encircle, circling, lap, do a lap around, do a lap of, "
    "make a lap around, drive a lap around, drive a circle around, make a circle around, drive in a circle around, "
    "go in a circle around, move in a circle around, walk in a circle around, circumnavigate, drive a loop around",
    "CLOCKWISE": "clockwise, rightward, rightwards",
    "COMMA": ",",
    "COUNTERCLOCKWISE": "counterclockwise, anticlockwise, counter clockwise, anti clockwise, leftward, leftwards",
    "DEGREES": "degree, degrees, deg, degs, °",
    "DET": "whichever, whatever, where the, the, teh, hte, a, an, my, your, its, some, any, this, those, these, "
    "our, their, his, her",
    "DIRECTION": "heading, bearing, direction, heading of, bearing of, compass heading, compass bearing, course",
    "EAST": "east, eastward, eastwards, eastern, easterly, due east, eastbound",
    "EVERY": "every, each, all, every one, each one, every single, each and every, each single, every last",
    "FACE": "face, facing",
    "FARTHEST": "farther, further, farthest, furthest, most distant, remotest, most remote, most far, most "
    "faraway, furthest away, farthest away, least close, least near",
    "FEET": "ft, foot, feet",
    "FOR": "for",
    "FORWARD": "forward, forwards, ahead, straight, straight ahead, straight on, straight forward, onward, "
    "onwards, frontward, frontwards, on ahead, right ahead",
    "FROM": "from, starting from, counting from, counted from, as counted from, seen from, as seen from, starting "
    "at, if you count from, when counting from, in from, over from",
    "FRONT": "in front of, the front of, to the front of, at the front of, on the near side of, on this side of, "
    "to the near side of, the near side of, ahead of, right in front of, just in front of",
    "FULL": "full, complete, whole, entire",
    "GO": "take up a position, take up position, take position, take a position, go, move, drive, walk, navigate, "
    "head, travel, proceed, run, roll, come, get, ride, continue, advance, going, moving, driving, walking, coming, "
    "getting, make your way, go on, keep going, carry on, go over, come over, head over, head out, drive over, walk "
    "over, move over, drive up, walk up, go up, come up, pull up, move yourself, navigate yourself, position "
    "yourself, place yourself, put yourself, go across, make way, set off, keep driving, keep moving, keep walking, "
    "race, rush, hurry, dash, wander, stroll, march, crawl, glide, cruise, steer, send yourself, get yourself, go "
    "and stand, go and wait, go and stop, go stand, go wait, come and stand, park up, sit, go sit, go and sit, sit "
    "down, go and sit down, lie down, go and lie down, creep, scoot, shift, inch, jog, swing by, drop by, stop by, "
    "make a beeline, go see, go and see, trundle, relocate, go and park, go directly, go right over",
    "HALF": "half",
    "HALFWAY": "half way to, halfway to, midway to, half the way to, half way towards, halfway towards, half way "
    "toward, halfway toward, half of the way to, half way over to, halfway over to",
    "HALT": "halt, freeze, stand still, stay still, stay put, hold still, hold on, hold your position, stay there, "
    "hold position, stay where you are, stop moving, stop there, stop right there, stop here, wait here, stay here, "
    "remain here, remain where you are, do nothing, do not move, don t move, never mind, stop where you are, wait "
    "where you are, wait there, pause, sit still, keep still, hold it, wait a moment, wait a second, wait for me, "
    "wait a minute, hang on, hold your ground, cease, stop driving, stop now, stand by, standby, remain still, "
    "remain there, don t go anywhere, do not go anywhere, stay in place, stop it, emergency stop, full stop",
    "HERE": "here, me, you, us, where you are, where you stand, where you are now, your position, your current "
    "position, where i am, where i stand, your location, your current location, right here, this place, this spot, "
    "your place, current position, where you are standing, where you re standing, where you re at, where you are "
    "right now, where you stand now, where we are, the spot you are on, here now",
    "INCHES": "inch, inches",
    "IT": "it, that one, this one, them, there, each of them, each one of them, the same one, that thing, this thing",
    "KEEP": "make sure, make sure that, ensure, ensure that, position yourself so that, place yourself so that, "
    "stand so that, position yourself with, place yourself with, stand with, orient yourself so that, orient "
    "yourself with, see to it that, stand so, turn yourself so that, align yourself so that, keep, keeping, have, "
    "having, put, putting, leave, leaving, hold, holding",
    "KILOMETRES": "km, kilometer, kilometers, kilometre, kilometres",
    "LEFT": "left, left hand, lefthand, far left, extreme left, very left",
    "LOOK": "look, looking, point yourself, orient yourself, gaze, point at, point to, point towards, point "
    "toward, orient, aim, aim at, stare, glance, watch, point your camera, look over, look straight, direct "
    "yourself, turn your camera, align yourself, peek, turn and look, face towards, face toward, face to, look in "
    "the direction of, turn to look, turn to face, turn and face, turn yourself to face, rotate to face, spin to "
    "face, aim yourself, turn around to face, turn so that you face, turn so you face, turn until you face, face "
    "yourself, turn until you are facing, rotate until you face, turn so that you are facing, point the camera, aim "
    "the camera",
    "MAKE": "make, do, take, perform, execute, making, doing, taking, hang, give me",
    "MANNER": "quickly, slowly, fast, quietly, swiftly, slow, rapidly, as fast as you can, as quickly as possible, "
    "as fast as possible, as slowly as possible, at full speed, as quickly as you can, speedily, cautiously, "
    "smoothly, promptly, safely, quick, at speed",
    "METRES": "m, meter, meters, metre, metres, mtr, mtrs",
    "MILLIMETRES": "mm, millimeter, millimeters, millimetre, millimetres",
    "NEAR": "until you reach, until you get to, until you are at, until you re at, until you arrive at, until you "
    "hit, until you come to, until you are next to, until you are near, near, next to, close to, beside, besides, "
    "alongside, adjacent to, up to, over to, close by, nearby, right next to, just by, right beside, by the side of, "
    "at the side of, to the side of, in the vicinity of, around by, near to, close up to, right up to, all the way "
    "to, along with, near by, as close as possible to, along, neighbouring, neighboring, touching, attached to, down "
    "to, across to, through to, over by, nearer to, closer to",
    "NEAREST": "nearer, closer, nearest, closest, most near, most close, least distant, least far, nearest to, "
    "closest to, most adjacent, closest by, nearest by",
    "NORTH": "north, northward, northwards, northern, northerly, due north, northbound",
    "NOT": "not, don t, dont, never, without, avoid, avoiding, except, but, unless, won t, can t, cannot, instead, "
    "rather, nor, neither, excluding, apart, skip, ignore, ignoring, stop short, no more, isn t, aren t",
    "NUMBER": "number, no, nr, #, num, numbered, no ., nr ., num .",
    "OF": "of, out of, among, amongst, from among, of all, out of all, from all, amongst all, among all",
    "ON": "on, upon",
    "OTHER": "other, remaining, another",
    "PASS": "pass, go past, walk past, drive past, move past, go by, pass by, drive by, walk by, get past, head "
    "past, go through, pass through, drive through, walk through, travel past, run past, roll past, going past, "
    "passing, continue past, past, go beyond",
    "POINT": "place, point, position, coordinates, location, coordinate, spot, cell",
    "POSS": "'s",
    "QUARTER": "quarter, quarters",
    "RETURN": "return, go back, come back, get back, head back, drive back, walk back, travel back, going back, "
    "coming back, returning, backtrack, run back, go all the way back, make your way back, return back, navigate "
    "back, come on back, come right back, go right back, go back again, go straight back, head on back",
    "RIGHT": "right, right hand, righthand, far right, extreme right, very right",
    "SEE": "you are facing, you re facing, you face, you are now facing, you see, you can see, you re seeing, you "
    "are seeing, you see now, you can currently see, you currently see, you see from here, you can see from here, "
    "you have in view, you spot, you notice, you observe, you can observe, you are looking at, you can see right "
    "now, you can view, you can spot, you re looking at, visible to you, you see right now, the robot sees, the "
    "robot can see, visible from here, visible from where you are, your camera sees, the camera sees, your camera "
    "can see, the camera can see, you are able to see, you perceive, your eyes can see, you see in front of you, you "
    "can see in front of you, you can see now, you have in sight, is visible, are visible, you now see, see, can "
    "see, you could see",
    "SEEN": "visible, seen, viewable",
    "SIDE": "side, corner, end, hand side, edge, hand end, flank",
    "SLIGHTLY": "slightly, a bit, a little, a little bit, a tad, bit, little, a touch",
    "SOUTH": "south, southward, southwards, southern, southerly, due south, southbound",
    "SPIN": "turn all the way around, turn all the way round, spin all the way around, rotate all the way around, "
    "turn completely around, turn fully around, spin, spinning, spins, whirl, twirl, pirouette, spin yourself",
    "STAND": "stand, stop, wait, park, stay, stopping, parking, waiting, finish, remain, settle, halt at, end up",
    "START": "start, beginning, origin, home, base, starting point, starting position, start position, where you "
    "started, where you came from, where you began, where you were, where you started from, starting place, starting "
    "location, initial position, initial location, original position, original location, original place, initial "
    "place, starting spot, where we started, where we began, where you were before, where you set off, where you "
    "left off, where you were at the start, where you were at first, place where you started, place you started, "
    "position where you started, point where you started, home position, home base, start point, place you started "
    "from, place where you began, place you began, spot where you started, start location, docking station, dock, "
    "point of departure, departure point, where you set out, where you were at the beginning, place you came from, "
    "where you first were, where you were standing, where you set out from, start again, position you started from, "
    "point you started from, spot you started from, starting pose",
    "STEPS": "step, steps, pace, paces, stepping",
    "STOP": ". ; ! : ?",
    "STRAFE": "strafe, sidestep, slide, side step, shuffle",
    "TAKE": "take me, bring me, guide me, lead me, take us, bring us, take yourself, bring yourself, lead us, "
    "accompany me, escort me, direct me, drive me, walk me, bring it, guide us, get me, lead the way, walk with me",
    "THEN": "then, while, whilst, as you, afterwards, afterward, after that, finally, next, lastly, followed by, "
    "subsequently, after this, when you are there, when you get there, once there, once you are there, when there, "
    "on arrival, when you arrive, once you arrive, from there, at last, to finish, to begin with, to start with, "
    "first of all, firstly, secondly, thirdly, when done, when you re done, when you are done, once done, upon "
    "arrival, at the end, in the end, when you re there, once you re there, once you get there, when finished, "
    "eventually, thereafter, later, when you have arrived, once you have arrived, as a last step, as the last step, "
    "first off, thence, once arrived, as soon as you arrive, as soon as you are there, when you reach it, once you "
    "reach it, having arrived",
    "TIMES": "times",
    "TO": "to, into, till, in order to",
    "TOWARD": "toward, towards, in the direction of, up towards, over towards",
    "TURN": "turn, rotate, pivot, swivel, turning, rotating, turn yourself, rotate yourself, turns, rotation, "
    "revolution, twist, bear, veer, swing, revolve, rotations, revolutions, turn round on the spot",
    "TWICE": "twice",
    "UNTIL": "until, till",
    "UTURN": "u turn, uturn, about face, about turn, turnaround, u turns, one eighty, face about, turn the other "
    "way, face the other way, look the other way, look behind you, look behind, face backwards, turn your back, turn "
    "back around, about faces, face the opposite direction, turn in the opposite direction, face the opposite way, "
    "turn to the opposite direction, turn the opposite way, turn to face the other way, reverse direction, reverse "
    "your direction, face the other direction, turn to face the opposite direction",
    "VIEW": "in view, in sight, in your view, in your field of view, within view, within sight, in the field of "
    "view, in your sight, within your view, within your field of view, within your sight, in field of view, in your "
    "vision, in your field of vision, in my view, in my field of view, currently in view, in the view, in front of "
    "you, ahead of you, in front of your camera, in the camera view, in your camera view, in camera view, within the "
    "field of view, in your line of sight, in front of me, right in front of you, in front of the camera, directly "
    "in front of you, straight ahead of you, from your view, on camera, on your camera, in your current view, in "
    "your fov, in the fov, within your fov, in fov, in front of the robot, in view of the camera, in the camera s "
    "view, in the robot s field of view, in the robot s view, in the current view, in current view, within your "
    "current view, in your current field of view, in the camera s field of view, in the picture",
    "WEST": "west, westward, westwards, western, westerly, due west, westbound",
    "WITH": "with",
    "YARDS": "yard, yards, yd, yds",
}
_SILENT: Final = (
    "yourself, each time, every time, please, could, can, would, will, kindly, hey, hi, hello, ok, okay, robot, "
    "just, now, thanks, thank, also, i, want, like, need, let, which, is, are, d, ll, ve, re, very, much, good, so, "
    "that, who, robo, dear, the robot, could you, can you, would you, will you, you should, you must, you need to, "
    "you have to, i want you to, be, i need you to, i d like you to, i would like you to, let s, like to, want to, i "
    "m, you re, we re, it s, thank you, right now, at once, immediately, for me, if you please, if you would, if you "
    "can, if you could, if you don t mind, would you mind, do you think you could, you can, you could, you may, you "
    "might, your task is to, your job is to, i d love you to, i want to, i d like to, need to, that s, as well, too, "
    "straight away, right away, alright, well, actually, simply, directly, carefully, gently, sir, buddy, friend, "
    "mate, hey there, hi there, try to, be so kind as to, be so good as to, go ahead and, i wish you to, you are to, "
    "tell the robot to, it is, there is, there are, that is, that are, which is, which are, stands, standing, "
    "located, lying, situated, placed, sitting, found, lies, sits, hanging, positioned, that you, currently, do me a "
    "favour and, do me a favor and, we, shall, should, must, help me, command, listen, really, single, own, being, "
    "only, yes, um, uh, oh, cheers, you are, i would like, i d like, i want you, we want you to, we need you to, you "
    "will, you ll, you shall, your goal is to, your mission is to, i command you to, i order you to, i ask you to, "
    "may i ask you to, would it be possible to, is it possible to, could you possibly, possibly, i would love you "
    "to, for us, if possible, whenever you re ready, when you are ready, when you re ready, whenever you are ready, "
    "feel free to, be able to, remember to, make sure to, make sure you, be sure to, start by, begin by, start with, "
    "begin with, finish by, end by, one by one, in turn, in order, in any order, one after the other, one after "
    "another, in a row, each in turn, what about, how about, in the room, in this room, in the house, in this house, "
    "on the map, on this map, around here, in the flat, in the apartment, in the whole house, in the building, "
    "across the room, on the far side of the room, at the far end of the room, starting with the closest, starting "
    "with the nearest, starting from the closest, starting from the nearest, starting with the nearest one, starting "
    "with the closest one, beginning with the closest, beginning with the nearest, closest first, nearest first, "
    "from nearest to farthest, from the nearest to the farthest, immediate, next thing, on your way, what you do is, "
    "exactly, of the ones, ones"
)


def _phrases() -> dict[tuple[str, ...], str]:
    phrases: dict[tuple[str, ...], str] = {tuple(option.split()): "" for option in _SILENT.split(", ")}
    for kind, spoken in _SPOKEN.items():
        options = spoken.split() if kind == "STOP" else [","] if kind == "COMMA" else spoken.split(", ")
        phrases.update({tuple(option.split()): kind for option in options})
    return phrases


PHRASES: Final = _phrases()
"""{words: token of the grammar, "" for what may be left out}."""
LONGEST: Final = max(map(len, PHRASES))
"""Words of the longest phrase."""
COMPASS_POINTS: Final = {
    "north": 0.0,
    "north north east": 22.5,
    "north east": 45.0,
    "east north east": 67.5,
    "east": 90.0,
    "east south east": 112.5,
    "south east": 135.0,
    "south south east": 157.5,
    "south": 180.0,
    "south south west": 202.5,
    "south west": 225.0,
    "west south west": 247.5,
    "west": 270.0,
    "west north west": 292.5,
    "north west": 315.0,
    "north north west": 337.5,
}
"""Degrees clockwise from north."""
