"""What people call things: other names of a class, and generic words that take several classes together."""

from typing import Final

_SAME: Final = """
tv: television, telly, tv set, television set, tv monitor, flat screen, flatscreen, tele, monitor, screen, display
couch: sofa, settee, loveseat, love seat, divan, chesterfield, corner sofa, futon, sectional, sofa bed
refrigerator: fridge, freezer, fridge freezer, icebox
trash can: bin, garbage can, trash bin, garbage bin, rubbish bin, dustbin, trashcan, trash, waste bin, wastebasket,
 waste basket, wastepaper basket, waste paper basket, litter bin, garbage, wastepaper bin, waste can, recycling bin,
 dust bin, rubbish, paper bin, waste container
potted plant: plant, pot plant, houseplant, house plant, flowerpot, flower pot, flower, pot flower, pottedplant,
 greenery, indoor plant
dining table: dinner table, diningtable, kitchen table, dinning table
coffee table: sofa table, cocktail table, low table
nightstand: night stand, bedside table, night table, bedside cabinet, night stand table, bedside stand
desk: writing desk, work desk, bureau, computer desk, office desk, writing table, work table, worktable, study table
wardrobe: closet, armoire, clothes cabinet, clothes cupboard
shelf: bookshelf, bookcase, book shelf, book case, shelving, rack, bookrack
cabinet: cupboard, sideboard, tv stand, tv cabinet, credenza
rug: carpet, mat, floor mat
picture: painting, photo, photograph, portrait, poster, artwork, picture frame, photo frame, wall picture, print
picture frame: picture, photo frame, painting, frame
curtain: drape, curtains, window curtain
lamp: light, lampshade, light fixture | floor lamp, standing lamp, ceiling lamp, table lamp, chandelier, reading lamp
kitchen counter: counter, countertop, worktop, kitchen worktop, kitchen countertop, work surface, kitchen unit
range hood: extractor hood, cooker hood, extractor, kitchen hood, exhaust hood, hood, extractor fan
stove: cooker, stovetop, hob, cooktop, range, oven, gas stove, kitchen stove
oven: stove, cooker, range
air conditioner: ac, aircon, air con, air conditioning, ac unit, a c, air conditioning unit
exercise bench: workout bench, weight bench, gym bench, bench press, training bench, fitness bench, weights bench
dumbbell: weight, weights, hand weight, barbell, free weight, dumb bell
sports ball: ball | football, basketball, soccer ball, volleyball, tennis ball, beach ball, gym ball, exercise ball
security camera: surveillance camera, cctv, cctv camera, camera
board: whiteboard, white board, blackboard, pinboard, noticeboard, notice board, bulletin board
door: doorway, entrance, exit | gate, entrance door, room door, front door
door handle: doorknob, door knob, handle, knob
seasoning box: spice box, spice rack, spice
tableware: dishes, crockery, dish, dinnerware, place setting | plate
tablet: ipad, tablet computer, tablet pc
window: window pane, window other, windowpane
person: human, human being | man, woman, somebody, someone, child, kid, guy, lady, boy, girl
bicycle: bike, cycle, push bike, pushbike, velo
car: automobile, auto, motorcar | sedan, van, taxi
motorcycle: motorbike, motor bike, scooter, moped, bike
airplane: plane, aeroplane, aircraft, jet
bus: coach, autobus, minibus
train: railway train, locomotive
truck: lorry, pickup truck
boat: ship, sailboat, rowboat
traffic light: traffic lights, stoplight, traffic signal, stop light
fire hydrant: hydrant
stop sign: stopsign
parking meter: parking ticket machine
bench: park bench, garden bench, seat bench
cat: kitty, pussycat | kitten
dog: doggy, hound | puppy
horse: pony
sheep: lamb
cow: cattle | bull
backpack: rucksack, knapsack, school bag, schoolbag, back pack
umbrella: parasol, brolly
handbag: purse, shoulder bag, hand bag
tie: necktie, neck tie
suitcase: luggage, travel case, trolley case, baggage
frisbee: flying disc
skis: ski
baseball bat: bat
baseball glove: baseball mitt, glove, mitt
skateboard: skate board
surfboard: surf board
tennis racket: racket, tennis racquet, racquet
bottle: flask | water bottle
wine glass: wineglass, glass, goblet, wine goblet
cup: mug, tumbler, beaker | teacup, tea cup, coffee cup, coffee mug
bowl: | salad bowl, fruit bowl, soup bowl
donut: doughnut
hot dog: hotdog
sandwich: panini
chair: | armchair, arm chair, office chair, swivel chair, easy chair, recliner, rocking chair, folding chair
stool: bar stool, barstool, footstool
bar stool: stool, barstool
bed: bedstead | double bed, single bed, king size bed, bunk
toilet: lavatory, loo, wc, water closet, toilet bowl
laptop: notebook computer, notebook, laptop computer, macbook, portable computer, computer
monitor: tv, computer screen, computer monitor, screen, display
mouse: computer mouse
remote: remote control, tv remote, controller, remote controller, clicker
keyboard: computer keyboard
cell phone: mobile phone, mobile, cellphone, phone, telephone, smartphone, smart phone, iphone
microwave: microwave oven
toaster: bread toaster
sink: basin, washbasin, wash basin, washbowl, kitchen sink, hand basin
book: | novel, textbook, paperback
clock: | wall clock, alarm clock
vase: flower vase
scissors: pair of scissors, shears
teddy bear: teddy, stuffed bear, stuffed animal, plush bear, soft toy, stuffed toy, plushie
hair drier: hair dryer, hairdryer, blow dryer, hairdrier
toothbrush: tooth brush
"""
_KINDS: Final = """
seat: chair, couch, sofa, armchair, stool, bar stool, bench, settee, loveseat, office chair, ottoman
table: table, dining table, coffee table, side table, end table, console table, kitchen table
place to sit: chair, couch, sofa, armchair, bench, stool, bar stool, settee, loveseat, office chair
place to throw away: trash can, trash bin, garbage bin, bin, garbage can
place to train: exercise bench, dumbbell, treadmill
place to drink: cup, wine glass, bottle, mug
place to store: cabinet, shelf, cupboard, wardrobe, bookshelf, drawer
furniture: chair, couch, bed, dining table, coffee table, table, desk, cabinet, shelf, wardrobe, nightstand, bench,
 stool
picture: picture, picture frame, painting, poster
bench: bench, exercise bench
light: lamp, light, traffic light
plant: potted plant, plant, tree, flower
bag: backpack, handbag, suitcase, bag
appliance: refrigerator, stove, oven, microwave, toaster, dishwasher, washing machine, air conditioner, range hood
kitchen appliance: refrigerator, stove, oven, microwave, toaster, dishwasher, range hood
vehicle: car, truck, bus, bicycle, motorcycle, train, boat, airplane
animal: dog, cat, bird, horse, sheep, cow, elephant, bear, zebra, giraffe
pet: dog, cat, bird
fruit: banana, apple, orange
vegetable: broccoli, carrot
food: banana, apple, orange, sandwich, pizza, hot dog, donut, cake, broccoli, carrot
cutlery: fork, knife, spoon
utensil: fork, knife, spoon
computer: laptop, computer
electronics: tv, laptop, cell phone, tablet, monitor
toy: teddy bear, sports ball, kite, frisbee
bin: trash can, trash bin, garbage bin, bin
container: trash can, seasoning box, cabinet, suitcase, vase, bottle
storage: cabinet, shelf, wardrobe, cupboard, bookshelf
drink: bottle, cup, wine glass
gym equipment: exercise bench, dumbbell, sports ball
exercise equipment: exercise bench, dumbbell, sports ball
"""
_FIRST_FIT: Final = """
table: desk
desk: table, dining table
place to sleep: bed, couch, sofa
place to eat: dining table, table, kitchen table, kitchen counter, coffee table, desk
place to work: desk, table, dining table
place to wash: sink, bathtub, shower
place to cook: stove, oven, microwave
place to read: book, newspaper, magazine, tablet
place to keep food: refrigerator, fridge, freezer
place to watch: tv, television, monitor
place to tell the time: clock
place to keep clothes: wardrobe, closet, dresser, chest of drawers
place for light: lamp
place to pee: toilet
place to write: desk, table, dining table
place to call: cell phone
"""
_GENERIC: Final = {"seating": "seat", "sitting place": "seat", "seater": "seat", "piece of furniture": "furniture"}
_DOING: Final = {
    "place to sit": "sit, sit down, sit on, rest, have a seat, take a seat, rest my legs, relax, be seated, sit "
    "upon, sit down on, sit in, seat myself",
    "place to sleep": "sleep, sleep on, lie down, lie down on, nap, take a nap, have a nap, lie on, sleep in, lie, "
    "go to sleep, have a sleep, lay down",
    "place to eat": "eat, eat on, eat at, dine, dine at, have dinner, have lunch, have breakfast, eat dinner, eat "
    "lunch, have a meal, eat from, have my dinner, eat breakfast, eat my lunch, eat my dinner, eat a meal",
    "place to work": "work, work at, work on, study, do my homework, do homework, study at, do office work",
    "place to write": "write, write on, write at, write a letter",
    "place to wash": "wash, wash my hands, wash hands, wash in, wash your hands, wash up, do the dishes, wash the "
    "dishes, rinse my hands, clean my hands, get water, wash my face, wash dishes",
    "place to cook": "cook, cook on, cook food, cook dinner, heat food, make dinner, cook a meal, warm up food, "
    "boil water, cook with, fry an egg, heat up food",
    "place to read": "read, read about",
    "place to throw away": "throw away trash, throw trash, throw this away, throw away rubbish, put rubbish in, "
    "put trash in, throw rubbish in, throw garbage, dispose of trash, throw something away, throw away garbage, "
    "throw out the trash, throw things away, put my trash, put trash, throw rubbish, throw away my trash, put the "
    "trash, put garbage, throw away litter, throw trash in, throw away paper, dump trash, throw my rubbish, drop "
    "litter",
    "place to keep food": "keep food cold, cool drinks, keep milk, keep food, store food, keep food fresh, put the "
    "milk, keep drinks cold, get a cold drink, find food, store milk, keep things cold, chill drinks",
    "place to watch": "watch, watch tv, watch a movie, watch television, watch a film, watch the news, watch "
    "movies, watch films",
    "place to tell the time": "tell the time, see the time, check the time, tell time, read the time, know the time",
    "place to drink": "drink, drink from, drink out of",
    "place to keep clothes": "hang clothes, keep clothes, hang my coat, put clothes, store clothes, put my "
    "clothes, hang my clothes, hang up my coat, hang my jacket",
    "place to train": "train, exercise, work out, lift weights, exercise with, work out with, do sports",
    "place to pee": "pee, relieve myself",
    "place for light": "light the room, give light, light up the room, brighten the room",
    "place to store": "store things, store books, put books, keep books, keep things, store stuff, put my books, "
    "store my things",
    "place to call": "call, call someone, phone, make a call, call with",
}
_PLACES: Final = (
    "somewhere comfortable, somewhere, something, anything, anywhere, a place, some place, a spot, a thing, "
    "someplace, places, things, place, thing, spot, furniture, an object, object, a good place, a nice place, a "
    "comfortable place, the place, the thing, the best place"
)
_LINKS: Final = (
    "to, where i can, i can, for me to, that i can, where one can, you can, one can, where you can, we can, for us to"
)


def _table(text: str) -> dict[str, tuple[str, ...]]:
    lines = text.replace("\n ", " ").strip().splitlines()
    parts = (line.split(":", 1) for line in lines)
    return {name: tuple(word.strip() for word in others.split(",") if word.strip()) for name, others in parts}


def _synonyms() -> dict[str, tuple[str, ...]]:
    """Return every name the class it names first, then that class's other names; narrower names only the class."""
    classes: dict[str, list[str]] = {}
    names: dict[str, list[str]] = {}
    for line in _SAME.replace("\n ", " ").strip().splitlines():
        name, _, rest = line.partition(":")
        same, narrower = ([w.strip() for w in part.split(",") if w.strip()] for part in (rest + "|").split("|")[:2])
        for word in (*same, *narrower):
            classes.setdefault(word, []).append(name)
        for word in (name, *same):
            names.setdefault(word, []).extend(other for other in same if other != word)
    for word, others in _table(_FIRST_FIT).items():
        classes.setdefault(word, []).extend(others)
    words = dict.fromkeys([*names, *classes])
    return {word: tuple(dict.fromkeys([*classes.get(word, ()), *names.get(word, ())])) for word in words}


SYNONYMS: Final[dict[str, tuple[str, ...]]] = _synonyms()
"""{word: classes it may mean, the most fitting first}; a class called exactly so always comes before all of them."""
KINDS: Final[dict[str, tuple[str, ...]]] = _table(_KINDS)
"""{generic word: classes it takes together}."""
KINDS.update({word: KINDS[kind] for word, kind in _GENERIC.items()})
ACTIVITIES: Final[dict[tuple[str, ...], str]] = {
    tuple(word.strip().split()): kind for kind, words in _DOING.items() for word in words.split(",")
}
"""{"sit down", as words: generic word}, of "somewhere to sit down"."""
PLACES: Final = tuple(tuple(words.split()) for words in _PLACES.split(", "))
LINKS: Final = tuple(tuple(words.split()) for words in _LINKS.split(", "))
"""What stands between a place and what is done there."""
OTHER_THINGS: Final = (
    "grand_piano piano bathtub shower mirror dresser fireplace radiator dishwasher ottoman printer speaker basket "
    "wall floor ceiling stairs staircase kitchen bedroom bathroom hallway garage balcony box room treadmill pillow "
    "blanket towel guitar column kettle fan candle statue projector newspaper magazine elevator ladder crib"
)
"""Things people speak of that no list above names: known words, refused by name where a map lacks them."""
