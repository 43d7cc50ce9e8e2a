"""Runs a validated program over its syntax tree, statement by statement, within budgets."""

import ast
import math
import operator
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NoReturn

from simaps_viz.errors import CommandError, PlanningError
from simaps_viz.language.grounding import Things, ordinal
from simaps_viz.language.primitives import Parameter, Primitive
from simaps_viz.language.program import IN_WORDS, Program, ProgramError, ProgramStuckError, bind, check_argument

_OPERATORS: Final[Mapping[type, Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}  # fmt: skip
_MAX_VALUE = 1e12

Caller = Callable[[Primitive, Mapping[str, Any]], Any]
"""Executes one primitive or function with all its arguments by name; returns the result of a look-up or function."""


class BudgetError(ProgramError):
    """A program took more steps, loop turns or time than it may."""


@dataclass(frozen=True)
class Budget:
    """The limits of one program. All but ``seconds`` stop a program at the same statement on every machine."""

    steps: int = 10_000
    """Statements and expressions evaluated."""
    loop_turns: int = 1_000
    """Turns of all loops together."""
    path_m: float = 1_000.0
    """Length of the path driven."""
    planned_cells: int = 1_000_000_000
    """Cells of the map times paths planned."""
    seconds: float = 120.0
    """Computing time, as a last resort; the time between two statements, while a viewer animates or waits, does not
    count."""


@dataclass(frozen=True)
class Turn:
    """The program is about to run, or has just run, one statement."""

    line: int
    """Counted from 1."""
    phase: Literal["before", "after"]


def interpret(program: Program, call: Caller, *, budget: Budget | None = None) -> Generator[Turn, None, None]:
    """Run a program as a generator that stops before and after every statement, also inside ``for`` and ``if``.

    ``next`` runs up to the next of these points; until it is called the program is paused; ``close`` stops it.

    Raises:
        CommandError: at run time, naming line and primitive; BudgetError when a budget is used up.
        PlanningError: naming line and primitive.
    """
    runner = _Runner(call, budget or Budget())
    turns = runner.block(program.tree.body)
    while True:
        runner.resume()
        turn = next(turns, None)
        if turn is None:
            return
        runner.pause()
        yield turn


class _Runner(ast.NodeVisitor):
    def __init__(self, call: Caller, budget: Budget) -> None:
        self._call_primitive = call
        self._budget = budget
        self._names: dict[str, Any] = {}
        self._steps = 0
        self._turns = 0
        self._seconds = 0.0
        self._since = 0.0

    def resume(self) -> None:
        """Start counting computing time."""
        self._since = time.thread_time()

    def pause(self) -> None:
        """Stop counting computing time."""
        self._seconds += time.thread_time() - self._since

    def block(self, body: list[ast.stmt]) -> Iterator[Turn]:
        for statement in body:
            yield Turn(statement.lineno, "before")
            yield from self._statement(statement)
            yield Turn(statement.lineno, "after")

    def _statement(self, node: ast.stmt) -> Iterator[Turn]:
        self._step(node)
        match node:
            case ast.Expr(value=value):
                self._value(value)
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                self._names[name] = self._value(value)
            case ast.For(target=ast.Name(id=name), iter=source, body=body):
                for item in self._several(source):
                    self._turns += 1
                    self._within(node, self._turns, self._budget.loop_turns, "loop turns")
                    self._names[name] = item
                    yield from self.block(body)
            case ast.If(test=test, body=body, orelse=orelse):
                yield from self.block(body if self._value(test) else orelse)
            case _:
                self._refuse(node, "not allowed in a program")

    def _value(self, node: ast.expr) -> Any:
        self._step(node)
        return self.visit(node)

    def visit_Constant(self, node: ast.Constant) -> Any:
        return node.value

    def visit_Name(self, node: ast.Name) -> Any:
        return self._names[node.id]

    def visit_List(self, node: ast.List | ast.Tuple) -> list:
        return [self._value(item) for item in node.elts]

    visit_Tuple = visit_List  # noqa: N815 - the name is that of ast

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Any:
        if isinstance(node.op, ast.Not):
            return not self._value(node.operand)
        number = self._number(node.operand)
        return -number if isinstance(node.op, ast.USub) else number

    def visit_Call(self, node: ast.Call) -> Any:
        call = bind(node)
        primitive = call.primitive
        arguments = {}
        for parameter in primitive.parameters:
            written = call.arguments.get(parameter.name)
            value = parameter.default if written is None else self._value(written)
            arguments[parameter.name] = value if written is None else self._checked(node, primitive, parameter, value)
        try:
            return self._call_primitive(primitive, arguments)
        except (ProgramError, ProgramStuckError):
            raise
        except CommandError as error:
            raise ProgramError(node.lineno, primitive.name, str(error)) from None
        except PlanningError as error:
            raise ProgramStuckError(node.lineno, primitive.name, str(error)) from None

    def _checked(self, node: ast.Call, primitive: Primitive, parameter: Parameter, value: Any) -> Any:
        """Check an argument's value; whole numbers become int."""
        wrong = check_argument(parameter, _kind(value), value)
        if wrong:
            raise ProgramError(node.lineno, primitive.name, wrong)
        if parameter.type in ("instance", "count", "rank") and isinstance(value, int | float):
            return int(value)
        return value

    def _several(self, node: ast.expr) -> Sequence[Any]:
        """Return what a loop goes over; nothing to do for an empty set is an error, not a success."""
        value = self._value(node)
        if isinstance(value, Things):
            self._within_words(node, lambda: value.expect(1))
            return value.items
        return self._list(node, value)

    def _list(self, node: ast.expr, value: Any) -> list:
        if not isinstance(value, list):
            self._refuse(node, f"expected a list, found {IN_WORDS[_kind(value)]}")
        return value

    def visit_Subscript(self, node: ast.Subscript) -> Any:
        items, index = self._value(node.value), self._value(node.slice)
        if not _is_number(index) or index != int(index):
            self._refuse(node, f"an index is a whole number, found {IN_WORDS[_kind(index)]}")
        if isinstance(items, Things):
            rank = int(index) + 1 if index >= 0 else int(index)
            return self._within_words(node, lambda: items.nth(rank))
        items = self._list(node, items)
        if not -len(items) <= index < len(items):
            rank = ordinal(int(index) + 1 if index >= 0 else -int(index))
            self._refuse(node, f"the {rank} item was asked for, but the list has {len(items)}")
        return items[int(index)]

    @staticmethod
    def _within_words(node: ast.expr, choose: Callable[[], Any]) -> Any:
        try:
            return choose()
        except CommandError as error:
            raise ProgramError(node.lineno, None, str(error)) from None

    def _number(self, node: ast.expr) -> float:
        value = self._value(node)
        if not _is_number(value):
            self._refuse(node, f"arithmetic is for numbers, found {IN_WORDS[_kind(value)]}")
        return value

    def visit_BinOp(self, node: ast.BinOp) -> float:
        operation, left, right = _OPERATORS[type(node.op)], self._number(node.left), self._number(node.right)
        if operation is operator.truediv and right == 0:
            self._refuse(node, "division by zero")
        value = operation(left, right)
        if not math.isfinite(value) or abs(value) > _MAX_VALUE:
            self._refuse(node, "a number grew too large")
        return value

    def visit_Compare(self, node: ast.Compare) -> bool:
        left = self._plain(node.left)
        for operation, other in zip(node.ops, node.comparators, strict=True):
            right = self._plain(other)
            ordered = not isinstance(operation, ast.Eq | ast.NotEq)
            if ordered and not (_is_number(left) and _is_number(right)):
                self._refuse(
                    node, f"only numbers have an order, found {IN_WORDS[_kind(left)]} and {IN_WORDS[_kind(right)]}"
                )
            if not _OPERATORS[type(operation)](left, right):
                return False
            left = right
        return True

    def _plain(self, node: ast.expr) -> Any:
        value = self._value(node)
        if isinstance(value, list | Things):
            self._refuse(node, "sets, lists and positions cannot be compared")
        return value

    def visit_BoolOp(self, node: ast.BoolOp) -> Any:
        value = None
        for part in node.values:
            value = self._value(part)
            if bool(value) != isinstance(node.op, ast.And):
                break
        return value

    def generic_visit(self, node: ast.AST) -> NoReturn:
        """Refuse what has no method of its own."""
        self._refuse(node, "not allowed in a program")

    def _step(self, node: ast.stmt | ast.expr) -> None:
        self._steps += 1
        self._within(node, self._steps, self._budget.steps, "steps")
        spent = self._seconds + time.thread_time() - self._since
        self._within(node, spent, self._budget.seconds, "seconds of computing")

    @staticmethod
    def _within(node: ast.stmt | ast.expr, used: float, allowed: float, unit: str) -> None:
        if used > allowed:
            raise BudgetError(node.lineno, None, f"stopped: the program took more than {allowed:g} {unit}")

    @staticmethod
    def _refuse(node: ast.AST, message: str) -> NoReturn:
        raise ProgramError(getattr(node, "lineno", 1), None, message)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _kind(value: object) -> str:
    """Return the kind of a value, as the validator names it."""
    match value:
        case bool():
            return "truth"
        case str():
            return "text"
        case int() | float():
            return "number"
        case Things():
            return "instances"
        case list():
            return "position" if len(value) == 2 and all(map(_is_number, value)) else "list"
    return "instance"
