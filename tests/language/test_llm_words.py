"""Which model and where, what it is told, and how answers of all shapes are read; no server is asked."""

import dataclasses
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_maps import TOY_POSE, toy_map

from simaps_viz.errors import CommandError, InputError
from simaps_viz.language.commands import Reading
from simaps_viz.language.llm import LLMReader, LLMReading, check_names, command_messages, read_answer, repair_messages
from simaps_viz.language.llm_chat import Dialect
from simaps_viz.language.llm_settings import LLMSettings, one_line, parse_llm_spec, said_in, without_key
from simaps_viz.language.primitives import FUNCTIONS, PRIMITIVES
from simaps_viz.language.program import parse_program
from simaps_viz.navigation.agent import answer

LOCAL = "http://127.0.0.1:11434/v1"


@pytest.mark.parametrize(
    ("spec", "model", "url"),
    [
        ("gpt-4o-mini", "gpt-4o-mini", "https://api.openai.com/v1"),
        (f"qwen2.5:7b@{LOCAL}", "qwen2.5:7b", LOCAL),
        (f"  qwen2.5:7b @ {LOCAL}/ ".replace(" @ ", " @"), "qwen2.5:7b", LOCAL),
        ("m@http://127.0.0.1:11434", "m", LOCAL),
        ("m@http://127.0.0.1:11434/", "m", LOCAL),
        (f"m@{LOCAL}/chat/completions", "m", LOCAL),
        ("m@HTTPS://example.org/api/v3/", "m", "https://example.org/api/v3"),
        ("org/model:free@https://example.org/v1", "org/model:free", "https://example.org/v1"),
        ("@cf/meta/llama@https://example.org/v1", "@cf/meta/llama", "https://example.org/v1"),
        ("m@http://[::1]:8000/v1", "m", "http://[::1]:8000/v1"),
    ],
)
def test_specs(spec: str, model: str, url: str) -> None:
    settings = parse_llm_spec(spec)
    assert settings == LLMSettings(url, model)
    assert (settings.timeout_s, settings.retries, settings.temperature) == (30.0, 2, 0.0)
    assert str(settings) == f"{model} at {url}"


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("", "found no name of a model"),
        (f"@{LOCAL}", "found no name of a model"),
        ("m@127.0.0.1:11434", "the address begins with http:// or https://"),
        ("m@", "the address begins with http:// or https://"),
        ("m@file:///etc/passwd", "expected http:// or https://, found file"),
        ("m@ftp://host/v1", "expected http:// or https://, found ftp"),
        ("m@http://", "expected e.g."),
        ("m@http://host:99999/v1", "something unreadable"),
        ("m@http://host:0/v1", "expected e.g."),
        ("m@http://a b/v1", "expected e.g."),
        ("m@http://[::1/v1", "something unreadable"),
        ("m\nn@http://host/v1", "found no name of a model"),
    ],
)
def test_specs_that_are_none(spec: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_llm_spec(spec)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("url", ["http://u:hunter2@host/v1", "https://host/v1?key=hunter2", "https://host/v1#hunter2"])
def test_secrets_in_an_address_are_refused_and_not_repeated(url: str) -> None:
    with pytest.raises(InputError, match="a key comes from the environment") as caught:
        parse_llm_spec(f"m@{url}")
    assert "hunter2" not in str(caught.value)


@given(st.text(max_size=80))
def test_any_spec_is_read_or_refused_in_one_line(spec: str) -> None:
    try:
        settings = parse_llm_spec(spec)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert settings.base_url.startswith(("http://", "https://"))
        assert settings.model


@pytest.mark.parametrize(
    "change", [{"timeout_s": 0}, {"retries": -1}, {"temperature": float("nan")}, {"max_tokens": 0}]
)
def test_settings_that_cannot_be(change: dict) -> None:
    with pytest.raises(InputError, match=next(iter(change))):
        dataclasses.replace(parse_llm_spec("m"), **change)


def test_where_a_key_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-1234567890")
    for url in ("https://example.org/v1", LOCAL, "http://localhost:1/v1", "http://127.8.8.8/v1", "http://[::1]/v1"):
        assert LLMSettings(url, "m").key() == "sk-1234567890"
    for url in ("http://example.org/v1", "http://192.168.1.7:8000/v1", "http://localhost.example.org/v1"):
        assert LLMSettings(url, "m").key() == "no-key-needed", "unencrypted, over a network"
    monkeypatch.delenv("OPENAI_API_KEY")
    assert LLMSettings(LOCAL, "m").key() == "no-key-needed"
    assert LLMSettings("http://192.168.1.7:8000/v1", "m").key() == "no-key-needed"
    with pytest.raises(InputError, match="asks for a key: set the variable OPENAI_API_KEY"):
        LLMReader(LLMSettings("https://example.org/v1", "m"))
    with pytest.raises(InputError, match="set the variable MY_KEY"):
        LLMReader(LLMSettings("https://example.org/v1", "m", api_key_env="MY_KEY"))


def test_a_reading_of_a_model_is_a_reading() -> None:
    assert isinstance(LLMReading("robot.turn(1)", ("by m",)), Reading)


# ---- what is told


@pytest.mark.parametrize("structured", [True, False])
def test_every_example_is_right_and_in_the_form_that_is_asked_for(structured: bool) -> None:
    messages = command_messages("turn", {"chair": 1}, structured=structured)
    assert [m.role for m in messages] == ["system", *["user", "assistant"] * (len(messages) // 2 - 1), "user"]
    programs, refusals = [], []
    for asked, answered in zip(messages[1:-1:2], messages[2:-1:2], strict=True):
        counts = json.loads(asked.content.splitlines()[0].partition(": ")[2])
        program, refusal = read_answer(answered.content)
        if program:
            check_names(parse_program(program), counts)
            programs.append(program)
        else:
            refusals.append(refusal)
    assert 'robot.move_to_nth_closest("chair", 3)' in programs
    assert 'robot.move_to_left("couch")\nrobot.turn_absolute(0)' in programs
    assert 'robot.move_to_object(nth(order(things("chair"), "left"), 2))' in programs
    simap = toy_map()
    for program in programs:  # the toy has the same classes: every example runs, or says why not in words
        assert answer(simap, program, TOY_POSE).status in ("ok", "refused"), program
    assert len(programs) >= 5 and len(refusals) >= 2


def test_what_does_not_change_comes_first_so_that_servers_can_keep_it() -> None:
    one = command_messages("turn left", {"chair": 1}, structured=True)
    two = command_messages("go to the couch", {"couch": 2}, structured=True)
    assert one[:-1] == two[:-1]
    assert one[-1] != two[-1]


def test_the_prompt_knows_every_call_rule_and_kind_of_argument() -> None:
    system = command_messages("turn", {}, structured=True)[0].content
    for primitive in PRIMITIVES.values():
        assert f"- robot.{primitive.name}(" in system and primitive.meaning in system
    for kind in {p.type for primitive in PRIMITIVES.values() for p in primitive.parameters}:
        assert f"\n- {kind}: " in system
    for function in FUNCTIONS.values():
        assert f"\n- {function.name}(" in system and function.meaning in system
        assert all(f"{p.name}: {p.type}" in system for p in function.parameters)
    assert "{" not in system.replace('{"program"', ""), "every field of the prompt is filled in"


@given(st.text(max_size=60), st.text(min_size=1, max_size=60))
def test_foreign_text_stays_on_its_line_and_in_its_quotes(command: str, label: str) -> None:
    lines = command_messages(command, {label: 2}, structured=False)[-1].content.split("\n")
    assert len(lines) == 2
    assert json.loads(lines[0].partition(": ")[2]) == {label: 2}
    assert json.loads(lines[1].removeprefix("Command: ")) == command


def test_a_repair_shows_the_answer_and_what_is_wrong() -> None:
    said, told = repair_messages("robot.fly()", "line 1: fly: not a primitive")
    assert (said.role, said.content, told.role) == ("assistant", "robot.fly()", "user")
    assert "line 1: fly: not a primitive" in told.content
    assert repair_messages("", "the answer is empty")[0].content, "servers refuse empty turns"


# ---- what is answered


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("robot.turn(1)", ("robot.turn(1)", "")),
        ("```\nrobot.turn(1)\nrobot.turn(2)\n```", ("robot.turn(1)\nrobot.turn(2)", "")),
        ("```python\nfor c in robot.instances('chair'):\n    robot.face('chair', c)\n```",
         ("for c in robot.instances('chair'):\n    robot.face('chair', c)", "")),
        ('{"program": "robot.turn(1)\\nrobot.turn(2)", "refusal": null}', ("robot.turn(1)\nrobot.turn(2)", "")),
        ('{"program": "robot.turn(1)\nrobot.turn(2)", "refusal": null}', ("robot.turn(1)\nrobot.turn(2)", "")),
        ('{"program": "  robot.turn(1)\\n  robot.turn(2)"}', ("robot.turn(1)\nrobot.turn(2)", "")),
        ('{"program": "", "refusal": "no such thing"}', ("", "no such thing")),
        ('{"refusal": "no such thing"}', ("", "no such thing")),
        ("refused: no such thing", ("", "no such thing")),
        ("REFUSED", ("", "no reason given")),
        ("<THINK>REFUSED: x</THINK>\n\nrobot.turn(1)", ("robot.turn(1)", "")),
        ("{1: robot}", ("{1: robot}", "")),
        ('```json\n{"program": "robot.turn(1)"}\n```\nor\n```json\n{"program": "robot.turn(2)"}\n```',
         ("robot.turn(2)", "")),
    ],
)  # fmt: skip
def test_answers(text: str, expected: tuple[str, str]) -> None:
    assert read_answer(text) == expected


@given(st.text(max_size=200) | st.text(alphabet='`{}":,programefusl\n\\ []', max_size=80))
def test_any_answer_is_a_program_a_refusal_or_a_command_error(text: str) -> None:
    try:
        program, refusal = read_answer(text)
    except CommandError:
        return
    assert bool(program) != bool(refusal)


def test_deeply_nested_answers_do_no_harm() -> None:
    assert read_answer('{"program":' * 5000)[0], "not JSON, so it is left to the validation of programs"


def test_names_are_checked_as_the_agent_does() -> None:
    simap = toy_map()
    counts = simap.counts()
    for program in (
        "robot.face('chair')",
        "robot.face('sofa')",
        "robot.move_to(robot.get_pos('robot'))",
        "robot.face('robot')",
        "robot.turn(1)\nrobot.face('unicorn')",
        "robot.face('chair', robot.closest_to('chair', 'unicorn'))",
        "robot.face(name='chair', instance=robot.between('chair', 'couch', 'dragon'))",
    ):
        said = answer(simap, program, TOY_POSE)
        try:
            check_names(parse_program(program), counts)
        except CommandError as error:
            assert said.status == "refused"
            assert str(error).startswith((said.reason or "").partition(". It has")[0])
            assert all(f"{label} ({n})" in str(error) for label, n in counts.items())
        else:
            assert said.status == "ok"


def test_foreign_words_become_one_short_line() -> None:
    assert one_line("a\n\tb\x1b[31m\u2028c") == "a b [31m c"
    assert len(one_line("x" * 999)) == 200
    assert said_in({"error": {"message": "m"}}) == said_in({"detail": "m"}) == said_in("m") == "m"
    assert said_in({"error": [1]}) == said_in(None) == said_in("<html>") == ""
    assert without_key("a sk-1234567890 b", "sk-1234567890") == "a ••• b"
    assert without_key("robot.turn(1)", "robot") == "robot.turn(1)", "a word like this is no secret"


def test_a_dialect_gets_plainer_until_nothing_is_left() -> None:
    dialect, steps = Dialect(), 0
    complaint = "max_completion_tokens, temperature and response_format"
    while (plainer := dialect.plainer(complaint)) is not None:
        dialect, steps = plainer, steps + 1
    assert steps == 3
    assert dialect == Dialect(structured=False, temperature=False, limit="max_completion_tokens")
