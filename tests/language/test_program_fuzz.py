"""Whatever text comes, a program is carried out or refused in words. ``SIMAPS_FUZZ_EXAMPLES`` sets how many are tried.

Four kinds of text: any characters at all; words of the language and of Python in any order; valid programs with pieces
changed, dropped and doubled; and syntax trees of Python's own grammar, written out.
"""

import ast
import os
import time
from collections.abc import Callable
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from program_words import VALID, WORDS, random_program
from toy_maps import TOY_POSE, toy_map

from simaps_viz.errors import SIMapsError
from simaps_viz.language.interpreter import Budget
from simaps_viz.language.primitives import PRIMITIVES
from simaps_viz.language.program import parse_program
from simaps_viz.navigation.agent import Agent, answer

EXAMPLES = int(os.environ.get("SIMAPS_FUZZ_EXAMPLES", "50"))
PATIENCE_S = 1.0 if EXAMPLES > 100 else 60.0
"""Processor time: in a long run by hand a second counts as hanging; a test suite on a busy machine is no clock."""
BUDGET = Budget(steps=200, loop_turns=20, path_m=30.0)

fuzzed = settings(
    max_examples=EXAMPLES, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much]
)


@pytest.fixture(scope="module")
def simap():
    return toy_map()


@pytest.fixture(scope="module")
def attempt(simap) -> Callable[[str], None]:
    """Return what must never raise anything but an error of ours, nor hang, nor drive on after a refusal."""

    def once(text: str) -> float:
        began = time.thread_time()
        agent = Agent(simap, TOY_POSE, budget=BUDGET)
        try:
            run = agent.rehearse(text)
            assert all(1 <= step.line <= text.count("\n") + text.count("\r") + 1 for step in run.steps)
            assert run.robot.path_length_m <= BUDGET.path_m
        except SIMapsError as error:
            assert str(error).isprintable() and str(error).startswith(("line ", "program: ")), str(error)
        return time.thread_time() - began

    def try_it(text: str) -> None:
        # a second time, because Python may have collected the garbage of all examples before
        assert once(text) < PATIENCE_S or once(text) < PATIENCE_S

    return try_it


@fuzzed
@given(st.text(max_size=120))
def test_any_text(attempt, text: str) -> None:
    attempt(text)


@fuzzed
@given(st.lists(st.sampled_from(WORDS), max_size=30).map("".join))
def test_any_words(attempt, text: str) -> None:
    attempt(text)


@fuzzed
@given(st.randoms(use_true_random=False))
def test_programs_of_functions(attempt, r: Random) -> None:
    attempt(random_program(r))


@st.composite
def mutated(draw: st.DrawFn) -> str:
    text = "\n".join(draw(st.lists(st.sampled_from(VALID), min_size=1, max_size=3)))
    for _ in range(draw(st.integers(1, 4))):
        a, b = sorted(draw(st.tuples(st.integers(0, len(text)), st.integers(0, len(text)))))
        b = min(b, a + draw(st.sampled_from([0, 1, 2, 8, 40])))
        put = draw(st.sampled_from(["", text[a:b] * 2, text[a:b][::-1]]) | st.sampled_from(WORDS) | st.text(max_size=3))
        text = text[:a] + put + text[b:]
    return text


@fuzzed
@given(mutated())
def test_mutated_programs(attempt, text: str) -> None:
    attempt(text)


NAMES = st.sampled_from(["x", "y", "c", "robot", "start", "_z", "match", "𝓻obot"])
CALLED = st.sampled_from([*PRIMITIVES, "fly", "__class__"])
PARAMETERS = st.sampled_from(["name", "instance", "n", "pos", "meters", "angle_deg", "side", "other", "name_a", None])
CONSTANTS = st.sampled_from(
    [
        *("chair", "couch", "dining table", "left", "north", "robot", "piano", "a\nb", "\ud800", "x" * 101),
        *(0, 1, 2, 3, -1, 0.5, 90, 1e6, 1e7, 10**400, True, False, None, 1j, b"x", ...),
    ]
)  # fmt: skip
OPERATORS = st.sampled_from([ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.Mod, ast.LShift]).map(
    lambda kind: kind()
)
COMPARISONS = st.sampled_from([ast.Eq, ast.NotEq, ast.Lt, ast.GtE, ast.Is, ast.In]).map(lambda kind: kind())
UNARY = st.sampled_from([ast.Not, ast.USub, ast.UAdd, ast.Invert]).map(lambda kind: kind())


def _load(name: str) -> ast.Name:
    return ast.Name(name, ast.Load())


def _call(name: str, arguments: list[ast.expr], keywords: list[ast.keyword]) -> ast.Call:
    return ast.Call(ast.Attribute(_load("robot"), name, ast.Load()), arguments, keywords)


def _compared(left: ast.expr, rest: list[tuple[ast.cmpop, ast.expr]]) -> ast.Compare:
    return ast.Compare(left, [operation for operation, _ in rest], [value for _, value in rest])


def _larger(inner: st.SearchStrategy[ast.expr]) -> st.SearchStrategy[ast.expr]:
    several = st.lists(inner, max_size=3)
    keywords = st.lists(st.builds(ast.keyword, PARAMETERS, inner), max_size=1)
    return st.one_of(
        st.builds(_call, CALLED, several, keywords),
        st.builds(_call, CALLED, several, keywords),
        st.builds(ast.Call, inner, several, keywords),
        st.builds(ast.Attribute, inner, NAMES, st.just(ast.Load())),
        st.builds(ast.List, several, st.just(ast.Load())),
        st.builds(ast.Tuple, several, st.just(ast.Load())),
        st.builds(ast.Subscript, inner, inner, st.just(ast.Load())),
        st.builds(ast.UnaryOp, UNARY, inner),
        st.builds(ast.BinOp, inner, OPERATORS, inner),
        st.builds(ast.BoolOp, st.sampled_from([ast.And(), ast.Or()]), st.lists(inner, min_size=2, max_size=3)),
        st.builds(_compared, inner, st.lists(st.tuples(COMPARISONS, inner), min_size=1, max_size=2)),
        st.builds(ast.IfExp, inner, inner, inner),
        st.builds(ast.Starred, inner, st.just(ast.Load())),
        st.builds(ast.NamedExpr, NAMES.map(lambda name: ast.Name(name, ast.Store())), inner),
        st.builds(lambda value: ast.JoinedStr([ast.FormattedValue(value, -1)]), inner),
        st.builds(
            lambda value, source: ast.ListComp(value, [ast.comprehension(ast.Name("x", ast.Store()), source, [], 0)]),
            inner,
            inner,
        ),
    )


EXPRESSIONS = st.recursive(st.one_of(st.builds(ast.Constant, CONSTANTS), NAMES.map(_load)), _larger, max_leaves=6)
TARGETS = st.one_of(NAMES, NAMES, NAMES).map(lambda name: ast.Name(name, ast.Store()))
SIMPLE = st.one_of(
    st.builds(_call, CALLED, st.lists(EXPRESSIONS, max_size=2), st.just([])).map(ast.Expr),
    st.builds(lambda target, value: ast.Assign([target], value, lineno=1), TARGETS, EXPRESSIONS),
    EXPRESSIONS.map(ast.Expr),
    st.sampled_from([ast.Pass(), ast.Break(), ast.Import([ast.alias("os")]), ast.Global(["x"])]),
)


def _blocks(inner: st.SearchStrategy[ast.stmt]) -> st.SearchStrategy[ast.stmt]:
    body = st.lists(inner, min_size=1, max_size=3)
    orelse = st.lists(inner, max_size=1)
    return st.one_of(
        st.builds(lambda t, i, b, e: ast.For(t, i, b, e, lineno=1), TARGETS, EXPRESSIONS, body, orelse),
        st.builds(ast.If, EXPRESSIONS, body, orelse),
        st.builds(ast.While, EXPRESSIONS, body, orelse),
    )


TREES = st.lists(st.recursive(SIMPLE, _blocks, max_leaves=4), min_size=1, max_size=4)


@pytest.mark.slow
@fuzzed
@given(TREES)
def test_any_syntax_tree(attempt, body: list[ast.stmt]) -> None:
    try:
        text = ast.unparse(ast.Module(body, []))
    except (ValueError, TypeError):  # some trees have no text: digits beyond Python's limit, an f-string in itself
        return
    attempt(text)


KINDS = {"number": "1.5", "label": "'chair'", "instance": "1", "count": "1", "object": "'couch'", "side": "'left'"}


@fuzzed
@given(st.lists(st.tuples(st.sampled_from(sorted(PRIMITIVES)), st.booleans()), min_size=1, max_size=5), st.data())
def test_well_formed_calls_are_never_syntax_errors(simap, calls: list[tuple[str, bool]], data: st.DataObject) -> None:
    """Calls with arguments of the right kinds pass validation; what then goes wrong is about the map."""
    lines = []
    for name, whole in calls:
        parameters = [p for p in PRIMITIVES[name].parameters if p.required or whole]
        written = [
            f"{p.name}={KINDS.get(p.type, '[1, 1]')}" if data.draw(st.booleans()) else KINDS.get(p.type, "[1, 1]")
            for p in parameters
        ]
        positional = [w for w in written if "=" not in w]
        if written[: len(positional)] == positional:
            lines.append(f"robot.{name}({', '.join(written)})")
    if lines:
        parse_program("\n".join(lines))
        assert answer(simap, "", TOY_POSE, program="\n".join(lines)).status in ("ok", "refused", "failed")
