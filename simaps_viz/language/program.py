"""The small Python of robot programs: parsed to a syntax tree and validated completely, before the robot moves.

A program is lines of calls on ``robot`` or of functions, assignments to a name, ``for`` over a set or list, and ``if``;
values are numbers, strings, lists, indexing with ``[]``, ``+ - * /`` on numbers, comparisons, ``and``, ``or``, ``not``.
Nothing is ever handed to Python to run: ``interpreter`` walks the tree.
"""

import ast
import math
import re
import unicodedata
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NoReturn

from simaps_viz.errors import CommandError, PlanningError
from simaps_viz.language.primitives import ARGUMENT_KINDS, CHOICES, FUNCTIONS, PRIMITIVES, Parameter, Primitive
from simaps_viz.structures import Pose2

MAX_SOURCE: Final = 10_000
"""Characters of a program."""
MAX_DEPTH: Final = 24
"""Levels of the syntax tree."""
MAX_NUMBER: Final = 1e6
MAX_TEXT: Final = 100
"""Characters of one string."""
MAX_ITEMS: Final = 200
"""Items of one list written out."""

_RESULT_TYPES = {"instances": "instance", "positions": "position", "position": "number", "list": "any", "any": "any"}
_ANYTHING = ("text", "truth", "number", "instance", "instances", "position", "positions", "list")
_ACCEPTS = {
    "label": ("text", "instance", "instances"),
    "object": ("text", "instance", "instances"),
    "things": ("text", "instance", "instances"),
    "target": ("text", "instance", "instances", "position", "list"),
    "number": ("number",),
    "count": ("number",),
    "rank": ("number",),
    "instance": ("number", "instance", "instances"),
    "position": ("position", "list"),
    "value": _ANYTHING,
}
"""{type of a parameter: kinds of values}; all other types take text."""
IN_WORDS = {
    "text": "a string",
    "truth": "a truth value",
    "instance": "a thing",
    "instances": "a set",
    "positions": "a list of positions",
    "list": "a list",
    "position": "a position",
    "number": "a number",
}
_SYNTAX = {
    "Attribute": "an attribute other than a call on robot",
    "Expr": "a value that goes nowhere",
    "FloorDiv": "//",
    "FunctionDef": "a definition",
    "ImportFrom": "import",
    "JoinedStr": "an f-string",
    "ListComp": "a comprehension",
    "Mod": "%",
    "Pow": "**",
}
_ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.Div)
_COMPARISONS = (ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE)
_SMALL_PYTHON = "a program is calls on robot, assignments, for, if, numbers, strings, lists, indexing and functions"
_NO_FILE = "<program>"
_HUGE = f"numbers go up to {MAX_NUMBER:.0f}"
# Python ends a line at these characters only; check_text refuses the others of str.splitlines
_NEWLINE = re.compile(r"\r\n|\r|\n")
_UNSEEN = {"Cc": "a control character", "Cf": "a formatting character", "Cs": "half a character"}
_SEPARATORS = {"Zl": "a line separator", "Zp": "a paragraph separator"}


class _LocatedError(Exception):
    """Knows the line and, if there is one, the primitive."""

    def __init__(self, line: int, primitive: str | None, message: str) -> None:
        super().__init__(f"line {line}: {primitive}: {message}" if primitive else f"line {line}: {message}")
        self.line, self.primitive, self.message = line, primitive, message
        self.pose: Pose2 | None = None  # where the robot is then, once it runs


class ProgramError(_LocatedError, CommandError):
    """A program cannot be carried out."""


class ProgramStuckError(_LocatedError, PlanningError):
    """The robot cannot get where a line of a program sends it."""


def lines_of(text: str) -> list[str]:
    """Return the lines of a program as Python counts them."""
    return _NEWLINE.split(text)


def check_text(text: str) -> None:
    """Refuse a text that is too long, or whose content differs from its appearance.

    Control characters, marks that turn the direction of writing, invisible characters and lone surrogates are refused
    everywhere, including strings and comments.

    Raises:
        CommandError: naming the line.
    """
    if len(text) > MAX_SOURCE:
        raise CommandError(f"program: expected at most {MAX_SOURCE} characters, found {len(text)}")
    for number, line in enumerate(lines_of(text), start=1):
        if line.isprintable():
            continue
        for character in line:
            kind = (_UNSEEN | _SEPARATORS).get(unicodedata.category(character))
            if kind and character != "\t":
                code = f"U+{ord(character):04X}"
                raise ProgramError(number, None, f"{kind} that cannot be seen ({code}) is not allowed in a program")


def too_deep(line: int) -> ProgramError:
    """Return the error for a program nested too deeply."""
    return ProgramError(line, None, f"too deeply nested; at most {MAX_DEPTH} levels are allowed")


def longest_line(text: str) -> int:
    """Return the number of the longest line: where nesting that stopped the parser itself is most likely found."""
    lengths = [len(line) for line in lines_of(text)]
    return lengths.index(max(lengths)) + 1


class _Letters:
    """The letters of a text, as Python folds a wide "ｒobot" into "robot"."""

    def __init__(self, text: str) -> None:
        self._lines = [line.encode() for line in lines_of(text)]

    def is_plain(self, name: str, line: int, start: int | None = None, end: int | None = None) -> bool:
        """Return whether a name is plain letters and is at a byte offset (its start or its end) of a line."""
        first = start if start is not None else (end or 0) - len(name)
        return name.isascii() and self._lines[line - 1][max(first, 0) : first + len(name)] == name.encode()


@dataclass(frozen=True, eq=False)
class Call:
    """One call, as written."""

    line: int
    primitive: Primitive
    arguments: Mapping[str, ast.expr]
    """Arguments by parameter name, without those left out."""

    def constant(self, name: str) -> object:
        """Return the argument if it is written out as a number or string, else None."""
        return literal(self.arguments.get(name))


@dataclass(frozen=True, eq=False)
class Program:
    """A validated program."""

    text: str
    tree: ast.Module
    calls: tuple[Call, ...]
    """In the order of the text."""

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """The text of each line, without its indent."""
        return tuple(line.strip() for line in lines_of(self.text))


def parse_program(text: str) -> Program:
    """Parse and validate a program.

    Raises:
        CommandError: naming the line and, where there is one, the primitive.
    """
    check_text(text)
    tree = _syntax_tree(text)
    if not tree.body:
        raise CommandError("program: expected at least one line, found none")
    _check_depth(tree)
    validator = _Validator(text)
    validator.block(tree.body, {})
    return Program(text, tree, tuple(validator.calls))


def _syntax_tree(text: str) -> ast.Module:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(text, _NO_FILE)
    except SyntaxError as error:
        # of a number with thousands of digits Python speaks at length, and about itself
        reason = _HUGE if "digits" in error.msg else f"this is not a program: {error.msg}; {_SMALL_PYTHON}"
        raise ProgramError(error.lineno or 1, None, reason) from None
    except (ValueError, RecursionError, MemoryError):
        raise too_deep(longest_line(text)) from None


def literal(node: ast.expr | None) -> object:
    """Return the value of a number (also with a minus) or string written out, else None."""
    match node:
        case ast.Constant(value=value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
    return None


def bind(node: ast.Call) -> Call:
    """Match a call's arguments to the parameters of its primitive or function, or raise ProgramError."""
    match node.func:
        case ast.Name(id=name) if name in FUNCTIONS:
            primitive = FUNCTIONS[name]
        case ast.Attribute(value=ast.Name(id="robot"), attr=name):
            primitive = PRIMITIVES.get(name)
            if primitive is None:
                raise ProgramError(node.lineno, name[:40], f"not a primitive; there are: {', '.join(PRIMITIVES)}")
        case ast.Attribute(value=ast.Name(id=name)):
            raise ProgramError(node.lineno, None, f"only robot can be called upon, not {name[:40]!r}")
        case _:
            form = "only calls of the form robot.primitive(…) and of functions are allowed"
            raise ProgramError(node.lineno, None, f"{form}; functions are: {', '.join(FUNCTIONS)}")

    def refuse(message: str) -> NoReturn:
        raise ProgramError(node.lineno, primitive.name, f"{message}; it is {primitive.signature}")

    names = [parameter.name for parameter in primitive.parameters]
    if len(node.args) > len(names):
        refuse(f"expected at most {len(names)} arguments, found {len(node.args)}")
    arguments = dict(zip(names, node.args, strict=False))
    for keyword in node.keywords:
        if keyword.arg not in names:
            refuse(f"no parameter {(keyword.arg or '**')[:40]!r}")
        if keyword.arg in arguments:
            refuse(f"parameter {keyword.arg!r} given twice")
        arguments[keyword.arg] = keyword.value
    missing = [p.name for p in primitive.parameters if p.required and p.name not in arguments]
    if missing:
        refuse(f"missing {', '.join(missing)}")
    return Call(node.lineno, primitive, arguments)


def check_argument(parameter: Parameter, kind: str, value: object = None) -> str | None:
    """Return why a value is invalid for a parameter, in words; None when it is valid.

    Args:
        parameter: what is expected.
        kind: of value, as `kind_of` names it; "any" where it is not known yet.
        value: the value itself, where it is known.
    """
    numbers = [one for one in (value if isinstance(value, list) else [value]) if isinstance(one, float)]
    unknown = parameter.type != "value" and not all(map(math.isfinite, numbers))  # such as the size of what has none
    found = repr(value) if isinstance(value, str | int | float) else IN_WORDS.get(kind, kind)
    found = "a number that is not known" if unknown else found
    wanted = f"{parameter.name}: expected {ARGUMENT_KINDS[parameter.type]}, found {found}"
    if unknown or (kind != "any" and kind not in _ACCEPTS.get(parameter.type, ("text",))):
        return wanted
    match value:
        case str() if parameter.type in CHOICES:
            return None if value in CHOICES[parameter.type] else wanted
        case str() if parameter.type in ("label", "object", "things", "text") and parameter.default != "":
            return None if value.strip() else wanted
        case int() | float() if parameter.type in ("count", "instance", "rank"):
            whole = value == int(value) and (value >= 1 or (parameter.type == "rank" and value != 0))
            return None if whole else wanted
        case list() if kind == "list" and parameter.type != "value":
            return wanted
    return None


def _check_depth(tree: ast.Module) -> None:
    """Raise ProgramError for trees too deep to walk; goes level by level, so it cannot itself run too deep."""
    level: list[ast.AST] = [tree]
    for _ in range(MAX_DEPTH):
        level = [child for node in level for child in ast.iter_child_nodes(node)]
        if not level:
            return
    raise too_deep(next((node.lineno for node in level if isinstance(node, ast.stmt | ast.expr | ast.keyword)), 1))


class _Validator(ast.NodeVisitor):
    """Walks the whole tree once, and infers the type of every expression from what each look-up returns."""

    def __init__(self, text: str) -> None:
        self._letters = _Letters(text)
        self.calls: list[Call] = []
        self._names: dict[str, str] = {}

    def block(self, body: list[ast.stmt], names: dict[str, str]) -> None:
        outer, self._names = self._names, names
        for statement in body:
            self._statement(statement)
        self._names = outer

    def _statement(self, node: ast.stmt) -> None:
        names = self._names
        match node:
            case ast.Expr(value=ast.Call() as call):
                self.visit_Call(call)
            case ast.Assign(targets=[ast.Name() as target], value=value):
                names[self._new_name(target)] = self._value(value)
            case ast.For(target=ast.Name() as target, iter=source, body=body, orelse=[]):
                kind = self._value(source)
                if kind not in _RESULT_TYPES:
                    self._refuse(node, f"for goes over a set or a list, not over {IN_WORDS[kind]}")
                self.block(body, {**names, self._new_name(target): _RESULT_TYPES[kind]})
            case ast.If(test=test, body=body, orelse=orelse):
                self._value(test)
                taken, skipped = dict(names), dict(names)
                self.block(body, taken)
                self.block(orelse, skipped)
                for name in taken.keys() & skipped.keys():
                    names[name] = taken[name] if taken[name] == skipped[name] else "any"
            case _:
                self._not_allowed(node)

    def _new_name(self, node: ast.Name) -> str:
        self._plain(node)
        if node.id == "robot" or node.id.startswith("_"):
            self._refuse(node, f"{node.id[:40]!r} cannot be assigned")
        return node.id

    def _value(self, node: ast.expr) -> str:
        kind = self.visit(node)
        if kind == "nothing":
            self._refuse(node, "a motion or tell gives no value; write it on a line of its own")
        return kind

    def visit_List(self, node: ast.List | ast.Tuple) -> str:
        if len(node.elts) > MAX_ITEMS:
            self._refuse(node, f"lists have at most {MAX_ITEMS} items, found {len(node.elts)}")
        kinds = [self._value(item) for item in node.elts]
        return "position" if kinds == ["number", "number"] else "list"

    visit_Tuple = visit_List  # noqa: N815 - the name is that of ast

    def visit_UnaryOp(self, node: ast.UnaryOp) -> str:
        if isinstance(node.op, ast.Not):
            self._value(node.operand)
            return "truth"
        if isinstance(node.op, ast.Invert):
            self._not_allowed(node.op, node)
        return self._number(node, [node.operand])

    def visit_BoolOp(self, node: ast.BoolOp) -> str:
        kinds = {self._value(value) for value in node.values}
        return kinds.pop() if len(kinds) == 1 else "any"

    def visit_BinOp(self, node: ast.BinOp) -> str:
        if not isinstance(node.op, _ARITHMETIC):
            self._not_allowed(node.op, node)
        return self._number(node, [node.left, node.right])

    def visit_Compare(self, node: ast.Compare) -> str:
        for operation in node.ops:
            if not isinstance(operation, _COMPARISONS):
                self._not_allowed(operation, node)
        for value in (node.left, *node.comparators):
            if self._value(value) in ("list", "position", "instances", "positions"):
                self._refuse(node, "sets, lists and positions cannot be compared")
        return "truth"

    def visit_Constant(self, node: ast.Constant) -> str:
        value = node.value
        if isinstance(value, bool):
            return "truth"
        if isinstance(value, int | float):
            if not abs(value) <= MAX_NUMBER:
                self._refuse(node, _HUGE)
            return "number"
        if isinstance(value, str):
            if len(value) > MAX_TEXT:
                self._refuse(node, f"strings have at most {MAX_TEXT} characters, found {len(value)}")
            if not value.isprintable():
                self._refuse(node, "strings have only characters that can be seen, on one line")
            return "text"
        self._refuse(node, f"a value of type {type(value).__name__} is not allowed; {_SMALL_PYTHON}")

    def visit_Name(self, node: ast.Name) -> str:
        self._plain(node)
        if node.id not in self._names:
            hint = "robot is only there to be called" if node.id == "robot" else "no value on every way to this line"
            self._refuse(node, f"{node.id[:40]!r}: {hint}")
        return self._names[node.id]

    def visit_Subscript(self, node: ast.Subscript) -> str:
        kind, index = self._value(node.value), node.slice
        if kind not in _RESULT_TYPES:
            self._refuse(node, f"{IN_WORDS[kind]} cannot be indexed")
        if isinstance(index, ast.Slice) or self._value(index) not in ("number", "any"):
            self._refuse(node, "an index is a whole number")
        return _RESULT_TYPES[kind]

    def _number(self, node: ast.expr, operands: list[ast.expr]) -> str:
        for operand in operands:
            kind = self._value(operand)
            if kind not in ("number", "any"):
                self._refuse(node, f"arithmetic is for numbers, not for {IN_WORDS[kind]}")
        return "number"

    def visit_Call(self, node: ast.Call) -> str:
        self._plain(node.func)
        for keyword in node.keywords:
            self._plain(keyword)
        call = bind(node)
        self.calls.append(call)
        primitive = call.primitive
        for parameter in primitive.parameters:
            value = call.arguments.get(parameter.name)
            if value is None:
                continue
            wrong = check_argument(parameter, self._value(value), literal(value))
            if wrong:
                raise ProgramError(node.lineno, primitive.name, wrong)
        return primitive.result

    def _plain(self, node: ast.expr | ast.keyword) -> None:
        """Refuse names that only look like others, see _Letters."""
        match node:
            case ast.Name(id=name, end_lineno=int() as line, end_col_offset=int() as end):
                plain = self._letters.is_plain(name, line, end=end)
            case ast.Attribute(value=value, attr=name, end_lineno=int() as line, end_col_offset=int() as end):
                self._plain(value)
                plain = self._letters.is_plain(name, line, end=end)
            case ast.keyword(arg=str() as name, lineno=line, col_offset=start):
                plain = self._letters.is_plain(name, line, start=start)
            case _:
                return
        if not plain:
            self._refuse(node, "names are written in plain letters")

    def generic_visit(self, node: ast.AST) -> NoReturn:
        """Refuse what has no method of its own."""
        self._not_allowed(node)

    def _not_allowed(self, piece: ast.AST, within: ast.AST | None = None) -> NoReturn:
        self._refuse(within or piece, f"{_name_of(piece)} is not allowed; {_SMALL_PYTHON}")

    def _refuse(self, node: ast.AST, message: str) -> NoReturn:
        raise ProgramError(getattr(node, "lineno", 1), None, message)


def _name_of(node: ast.AST) -> str:
    """Return Python's name of a syntax node, in lower case words."""
    name = type(node).__name__
    return _SYNTAX.get(name, name.lower())
