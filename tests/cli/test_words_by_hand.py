"""Words of errors, progress, help and completion, and what drawing and studies are handed."""

from __future__ import annotations

import pickle
import signal
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer
from tests.cli.test_cli import run

import eomcheck
from eomcheck import __version__, console
from eomcheck.errors import (
    CallError,
    EngineError,
    InputError,
    RefusedError,
    UnknownNameError,
    at_least_one,
    described_error,
    did_you_mean,
    distinct,
    message_of,
    one_line,
    raised,
    registered,
    required,
    safe_repr,
    whole_number,
)
from eomcheck.lab.store.record_file import Record
from eomcheck.safe_output import counted, printable, to_ascii, without_control_characters

application: Any = import_module("eomcheck.cli.application")
study: Any = import_module("eomcheck.cli.study_commands")

# ---- Errors --------------------------------------------------------------------------------------


def test_one_line_has_no_breaks_no_control_characters_and_no_middle_if_it_is_long():
    assert one_line("  a\n\tb  c\x1b[0m\u202e ") == "a b c\ufffd[0m\ufffd"
    whole = "".join(chr(ord("a") + i % 26) for i in range(900))
    assert one_line(whole) == whole
    longer = whole + "!"
    assert one_line(longer) == f"{longer[:600]} ... {longer[-300:]}"


def test_errors_are_told_by_type_and_message_also_where_these_cannot_be_read():
    assert described_error(KeyError("x")) == "KeyError: 'x'"
    assert (message_of(ValueError()), described_error(ValueError())) == ("", "ValueError")

    class Broken(Exception):
        def __str__(self):
            raise self.args[0]

    said = "its text cannot be read: __str__ raises LookupError"
    assert message_of(Broken(LookupError())) == said
    assert described_error(Broken(LookupError())) == f"Broken: {said}"
    with pytest.raises(KeyboardInterrupt):
        message_of(Broken(KeyboardInterrupt()))
    at: Any = SimpleNamespace(filename="/far/away/own.py", lineno=3)
    assert raised(KeyError("x"), at) == "raised KeyError: 'x' (own.py, line 3)"
    assert raised(KeyError("x"), None) == "raised KeyError: 'x'"
    ended = CallError("Engine.bias", "gave no answer in 60 s")
    assert (str(ended), ended.name) == ("Engine.bias gave no answer in 60 s", "Engine.bias")
    assert raised(ended, None) == "gave no answer in 60 s"
    assert str(InputError("a\nb")) == "a b"


def test_errors_come_through_processes_with_all_that_they_hold():
    refused = RefusedError("a′", 1e-17, 1e-15, "a′ is singular", np.eye(2))
    again = pickle.loads(pickle.dumps(refused))
    assert (type(again), str(again)) == (RefusedError, "a′ is singular")
    assert (again.what, again.rcond, again.threshold) == ("a′", 1e-17, 1e-15)
    assert again.matrix.tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert RefusedError("M", 1.0, 2.0, "why").matrix is None
    unknown = pickle.loads(pickle.dumps(UnknownNameError("claim", "bia", iter(["bias", "motion"]))))
    assert str(unknown) == "unknown claim 'bia' (did you mean 'bias'?); known: bias, motion"
    assert (unknown.kind, unknown.name, unknown.known) == ("claim", "bia", ("bias", "motion"))


def test_a_hint_is_the_nearest_name_in_any_case_and_none_that_is_far():
    assert did_you_mean("KANE", ["au", "Kane", "kanes"]) == " (did you mean 'Kane'?)"
    assert did_you_mean("abcdef", ["abcxyz"]) == "", "half of it is not near"
    assert did_you_mean("abcdefg", ["abcdexy"]) == " (did you mean 'abcdexy'?)"


def test_names_are_those_of_a_registry_each_once_and_at_least_one():
    assert registered("claim", "a", {"a": 1}) == 1
    for name in ("b", 3, None, ["a"]):
        with pytest.raises(UnknownNameError, match="unknown claim"):
            registered("claim", name, {"a": 1})
    assert distinct("keys", ["b", "a", "b"]) == ("b", "a") and distinct("keys", []) == ()
    for wrong in ("ab", 3, [[1]]):
        with pytest.raises(InputError) as error:
            distinct("keys", wrong)  # type: ignore[arg-type]
        assert str(error.value) == f"keys = {wrong!r}, expected a list of names"
    assert at_least_one("keys", iter(["b", "b"])) == ("b",)
    with pytest.raises(InputError) as error:
        at_least_one("keys", [])
    assert str(error.value) == "keys = [] names nothing, expected at least one name"


@pytest.mark.parametrize(
    ("value", "how", "result"),
    [
        (1, {}, 1),
        (0, {}, "n = 0, expected a whole number of at least 1"),
        (0, {"least": 0}, 0),
        (-5, {"least": None}, -5),
        (np.int64(7), {"most": 7}, 7),
        (8, {"most": 7}, "n = 8, expected at most 7"),
        (True, {}, "n = True, expected a whole number of at least 1"),
        (2.0, {}, "n = 2.0, expected a whole number of at least 1"),
        ("2", {"least": None}, "n = '2', expected a whole number"),
        (None, {"least": -3}, "n = None, expected a whole number of at least -3"),
    ],
)
def test_a_whole_number_is_none_of_booleans_and_texts_and_within_its_bounds(value, how, result):
    if isinstance(result, int):
        found = whole_number("n", value, **how)
        assert (found, type(found)) == (result, int)
    else:
        with pytest.raises(InputError) as error:
            whole_number("n", value, **how)
        assert str(error.value) == result


def test_a_value_is_shown_also_where_it_cannot_be_printed():
    class Mute:
        def __repr__(self):
            raise LookupError

    assert safe_repr([1, "a\nb"]) == "[1, 'a\\nb']"
    assert safe_repr(1 << 20000) == "a number of 20001 bits"
    assert safe_repr(Mute()) == "a Mute whose __repr__ raises LookupError"


def test_a_library_that_is_missing_is_named_with_the_extra_that_it_comes_with():
    assert required("pickle") is pickle and required("pickle", "spare") is pickle
    said = "the library 'no_such_library' is not installed (No module named 'no_such_library')"
    for extra, hint in ((None, ""), ("spare", "; it comes with the extra `spare`")):
        with pytest.raises(EngineError) as error:
            required("no_such_library", extra)
        assert str(error.value) == said + hint


# ---- Output --------------------------------------------------------------------------------------


def test_counts_have_one_and_many():
    said = [counted(n, what) for what in ("state", "identity", "day") for n in (0, 1, 2)]
    assert said == [
        *("0 states", "1 state", "2 states", "0 identities", "1 identity", "2 identities"),
        *("0 days", "1 day", "2 days"),
    ]


def test_what_controls_a_terminal_or_turns_a_text_is_replaced():
    odd = "a\u2028\x07\ud800\u2066b\tc\nd\u200f"
    assert printable(odd) == "a \ufffd\ufffd\ufffdb c d\u200f"
    assert without_control_characters(odd) == "a\ufffd\ufffd\ufffd\ufffdb\tc\nd\u200f"
    assert [to_ascii(x) for x in "Ωω\u0301½┼│╌¤"] == [
        "Omega",
        "omega",
        "",
        "1?2",
        "+",
        "|",
        "-",
        "?",
    ]


# ---- Progress ------------------------------------------------------------------------------------


def test_what_goes_on_is_named_by_the_innermost_with_its_count():
    now = console._now
    before = [*now]
    with console.progress("checking {state} of {claim}", 12) as advance:
        assert now == [*before, "checking 12 states of 12 claims"]
        advance()
        with console.activity("reading"):
            assert now[-1] == "reading"
        with console.progress("", 3):
            assert now[-1] == "checking 12 states of 12 claims", "one without a label is no other"
        with console.progress("proving {identity}", 1):
            assert now[-1] == "proving 1 identity"
        with console.polled_progress("moving", 1.0, lambda: 0.5):
            assert now[-1] == "moving"
        with console.polled_progress("checking {state}", 3, lambda: 1):
            assert now[-1] == "checking 3 states", "off a terminal the noun is no pattern either"
    assert now == before
    with pytest.raises(ValueError), console.activity("failing"):
        raise ValueError
    assert now == before and not console._showing.locked()
    assert console._NOUN.sub(console._many, "checking {state} and {identity}") == (
        "checking states and identities"
    )


def test_a_bar_is_shown_on_a_terminal_by_the_outermost_alone(monkeypatch):
    made: list[dict[str, Any]] = []

    class Bar(console.Progress):
        def __init__(self, *columns: Any, **how: Any):
            made.append({"columns": columns} | how)
            super().__init__(*columns, **how)

    def terminal(stderr: bool = False, **how: Any) -> Any:
        assert stderr
        return real(file=sys.stderr, force_terminal=True)

    real = console.Console
    monkeypatch.setattr(console, "Progress", Bar)
    monkeypatch.setattr(console, "Console", terminal)
    with console.progress("checking {state}", 4) as advance:
        assert console._showing.locked()
        with console.progress("drawing {state}", 2):
            pass
        with console.progress("", 2):
            pass
        assert console._showing.locked()
        advance()
    assert not console._showing.locked()
    assert [one["disable"] for one in made] == [False, True, True]
    assert made[0]["columns"][0].text_format == "checking states"
    assert made[0]["speed_estimate_period"] == 6 * 3600.0 and made[0]["transient"]
    with console.progress("", 4):
        assert not console._showing.locked()
    assert made[-1]["disable"]


def test_a_step_of_progress_stops_a_process_that_was_told_to_end_once():
    with console.progress("", 3) as advance:
        console._stopped.set()
        with pytest.raises(KeyboardInterrupt):
            advance()
        assert not console._stopped.is_set()
        advance()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_are_heard_once_and_handlers_are_what_they_were(number):
    told: list[int] = []
    before = signal.signal(number, lambda number, frame: told.append(-number))
    mine = signal.getsignal(number)
    try:
        with pytest.raises(KeyboardInterrupt), console.deferring_interrupts():
            signal.raise_signal(number)
            assert told == []
            signal.raise_signal(number)  # the second does what it would have done
            assert told == [-number]
            told.append(0)
        assert told == [-number, 0] and signal.getsignal(number) is mine
        hook = sys.unraisablehook
        with pytest.raises(KeyboardInterrupt), console.interruptible():
            assert sys.unraisablehook is not hook
            signal.raise_signal(number)
        assert sys.unraisablehook is hook and not console._stopped.is_set()
        with console.deferring_interrupts():
            pass
        signal.signal(number, signal.SIG_IGN)
        with console.deferring_interrupts():
            signal.raise_signal(number)  # what is ignored stays ignored
    finally:
        signal.signal(number, before)


# ---- Help ----------------------------------------------------------------------------------------


def test_alone_it_greets_with_its_version_and_whole_commands(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "300")
    assert run(monkeypatch=monkeypatch) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"eomcheck {__version__}: are equations of motion right, how accurate are they, what do "
        "they cost?",
        "",
        "your functions: M, bias and so on   eomcheck check FILE.py",
        "your engine                         eomcheck validate --engine FILE:CLASS",
        "a scene: built-in, yours, a URDF    eomcheck validate --scene SCENE",
        "all at once                         eomcheck validate",
        "all commands                        eomcheck --help",
    ]
    assert run("--version", monkeypatch=monkeypatch) == 0
    assert capsys.readouterr().out == f"eomcheck {__version__}\n"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("--links <int>", "--links N"),
        ("--scale <float>", "--scale X"),
        ("--json <path>", "--json FILE"),
        ("--figures <path>", "--figures FOLDER"),
        ("--folder <path>", "--folder FOLDER"),
        ("--references <path>", "--references FOLDER"),
        ("--suite <path>", "--suite FOLDER"),
        ("--word <str>", "--word TEXT"),
        ("--other <choice>", "--other CHOICE"),
        ("path <path>", "path"),
        ("--dark", "--dark"),
        ("--set NAME=VALUE", "--set NAME=VALUE"),
    ],
)
def test_help_names_values_by_what_they_are(name, told):
    assert application.option_label(name) == told


def test_a_usage_error_is_a_sentence_that_leads_to_help():
    class Wrong(Exception):
        ctx: Any = None
        message = "No such option: --sceen"

        def format_message(self) -> str:
            return "No such\n option.."

    assert application.usage_error(ValueError("x")) is None
    assert application.usage_error(Wrong()) == "eomcheck: No such option (see eomcheck --help)"
    wrong = Wrong()
    wrong.ctx = SimpleNamespace(command_path="eomcheck list")
    assert application.usage_error(wrong) == "eomcheck: No such option (see eomcheck list --help)"
    hinted: Any = wrong
    hinted.option_name, hinted.possibilities = "--sceen", ["--scene", "--seed"]
    hint = "No such option: --sceen (did you mean '--scene'?)"
    assert application.usage_error(hinted) == f"eomcheck: {hint} (see eomcheck list --help)"
    hinted.possibilities = []
    assert application.usage_error(hinted) == "eomcheck: No such option (see eomcheck list --help)"
    alone = type("NoArgsIsHelpError", (Wrong,), {})()
    group = SimpleNamespace(name="draw", names=lambda context: ["scene", "structure"])
    alone.ctx = SimpleNamespace(command_path="eomcheck draw", command=group)
    needed = "draw needs a command: scene, structure"
    assert application.usage_error(alone) == f"eomcheck: {needed} (see eomcheck draw --help)"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("validate --examples many", "'--examples': 'many', expected a whole number"),
        ("simulate --tolerance abc", "'--tolerance': 'abc', expected a number"),
    ],
)
def test_a_value_that_is_no_number_is_repeated_in_the_message(words: str, sentence: str):
    with pytest.raises(Exception, match="Input should be a valid") as problem:
        application.app(words.split(), prog_name="eomcheck", standalone_mode=False)
    command = words.partition(" ")[0]
    expected = f"eomcheck: Invalid value for {sentence} (see eomcheck {command} --help)"
    assert application.usage_error(problem.value) == expected


@pytest.mark.parametrize(
    ("message", "words", "expected"),
    [
        ("links = '0', expected 1", "validate --links 0", "--links '0', expected 1"),
        ("per_size = 0", "study agreement --per-size=0", "--per-size 0"),
        ("links = 3: it has none", "validate --links-of 3", "links = 3: it has none"),
        ("links = 3: it has none", "validate", "links = 3: it has none"),
        ("links are few", "validate --links 3", "links are few"),
        ("t_end = -1.0, expected s", "simulate --end -1", "--end -1.0, expected s"),
        ("u[1] = nan", "acceleration --speeds 1,nan", "--speeds nan"),
        ("t_end = -1.0, expected s", "simulate -1", "t_end = -1.0, expected s"),
    ],
)
def test_an_error_names_an_option_as_it_was_typed(message: str, words: str, expected: str):
    assert application.as_typed(message, words.split()) == expected


@pytest.mark.parametrize("words", [(), ("validate",), ("study",), ("study", "accuracy")])
def test_h_is_help(words: tuple[str, ...], monkeypatch, capsys):
    assert run(*words, "-h", monkeypatch=monkeypatch) == 0
    first = capsys.readouterr().out
    assert run(*words, "--help", monkeypatch=monkeypatch) == 0
    assert capsys.readouterr().out == first and "-h, --help" in first


@pytest.mark.parametrize(("columns", "width"), [(40, 38), (80, 78), (81, 78), (300, 78)])
def test_help_is_two_columns_narrower_than_a_terminal_and_never_wide(monkeypatch, columns, width):
    monkeypatch.setattr(application, "get_terminal_size", lambda: SimpleNamespace(columns=columns))
    assert application.help_width() == width


def test_commands_are_listed_with_their_first_sentence_and_hidden_ones_are_not(monkeypatch, capsys):
    made = application.CommandLine(
        name="own", cls=application.CommandGroup, rich_markup_mode=None, add_completion=False
    )

    @made.command("first")
    def first(links: int = 3, figures: Path | None = None) -> None:
        """Do one thing
        over two lines.

        And say more.
        """

    @made.command("secret", hidden=True)
    def secret() -> None:
        """Nobody sees it."""

    @made.command()
    def bare(words: list[str]) -> None: ...

    with pytest.raises(SystemExit):
        made(["--help"], prog_name="own")
    said = capsys.readouterr().out
    rows = said[said.index("Commands") : said.index("Exit codes")].split("\n")
    assert [" ".join(x.split()) for x in rows if x.strip()][1:] == [
        "first Do one thing over two lines.",
        "bare",
    ]
    codes = " ".join(said[said.index("Exit codes:") :].split())
    assert codes == " ".join(
        ["Exit codes:", *(f"{code} {what}" for code, what in application.EXIT_CODES.items())]
    )
    with pytest.raises(SystemExit):
        made(["first", "--help"], prog_name="own")
    said = capsys.readouterr().out
    assert "--links N" in said and "--figures FOLDER" in said and "secret" not in said
    assert "<" not in said


# ---- Completion ----------------------------------------------------------------------------------


def test_the_last_of_several_keys_is_completed_and_those_before_it_stay(monkeypatch):
    known = {"scene": ["snake", "sleigh"], "robot": ["snail", "paper"]}
    monkeypatch.setattr(application, "declared_keys", known.__getitem__)
    completed = application.completer("scene", "robot", more=("all", "snow"))
    assert completed("sn") == ["snake", "snail", "snow"]
    assert completed("a,sleigh,s") == [
        f"a,sleigh,{x}" for x in ("snake", "sleigh", "snail", "snow")
    ]
    assert completed("paper,") == [
        f"paper,{x}" for x in (*known["scene"], *known["robot"], "all", "snow")
    ]
    assert completed("x") == [] and application.completer("scene")("a") == []


def test_keys_are_read_from_sources_and_from_what_packages_announce(monkeypatch, tmp_path):
    (tmp_path / "scenes").mkdir()
    for name, key in (("b", "two-words"), ("a", "one")):
        (tmp_path / "scenes" / f"{name}.py").write_text(f'class X:\n    key = "{key}"\n')
    (tmp_path / "scenes" / "notes.txt").write_text('    key = "none"\n')
    (tmp_path / "engines").mkdir()
    (tmp_path / "engines" / "own.py").write_text(
        "".join(f'class X:\n    key = "{x}"\n' for x in ("own", "own64_file", "own_mjcf", "own64"))
        + '        key = "inner"\n'
    )
    asked: list[str] = []

    def points(group: str) -> list[Any]:
        asked.append(group)
        return [SimpleNamespace(name="far")] if group == "eomcheck.scenes" else []

    monkeypatch.setattr(application, "ROOT", tmp_path)
    monkeypatch.setattr(application, "entry_points", points)
    assert application.declared_keys("scene") == ["one", "two-words", "far"]
    assert application.declared_keys("engine") == ["own", "own64"]
    assert asked == ["eomcheck.scenes", "eomcheck.engines"]


# ---- Drawing -------------------------------------------------------------------------------------


@pytest.fixture
def drawn(monkeypatch, tmp_path) -> list[Any]:
    """Return a list of what is handed to whatever draws, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    seen: list[Any] = []

    def moved(scene, how, until, count, u0):
        assert u0 is None
        seen.append(("moved", scene.structure, how, until, count))
        return ["sketch"], np.array([0.0, 2.0]), 3

    def structure(scene, formulation, q, v):
        return scene.structure, formulation.key

    lab = "eomcheck.lab"
    monkeypatch.setattr(f"{lab}.show.pictures.sketches_of_motion", moved)
    monkeypatch.setattr(f"{lab}.show.pictures.draw_motion", lambda *x: seen.append(x))
    monkeypatch.setattr(
        f"{lab}.show.pictures.posed_sketch", lambda scene, q: (scene.structure, "names")
    )
    monkeypatch.setattr(f"{lab}.show.pictures.draw_scene", lambda *x: seen.append(x))
    monkeypatch.setattr(f"{lab}.show.pictures.structure_of", structure)
    monkeypatch.setattr(f"{lab}.show.pictures.draw_structure", lambda *x: seen.append(x))
    return seen


def test_a_moving_picture_is_of_its_motion_and_a_still_one_of_its_pose(drawn, monkeypatch, capsys):
    gif, svg = Path("a.gif"), Path("a.svg")

    def drew(*words: object) -> list[Any]:
        drawn.clear()
        assert run("draw", *map(str, words), monkeypatch=monkeypatch) == 0
        assert capsys.readouterr().out == f"written: {words[1]}\n"
        return [*drawn]

    frames = ["sketch"], [0.0, 2.0], gif, 3
    assert drew("scene", gif) == [("moved", "snake[7]", "au", 2.0, 40), frames]
    how = "--scene", "coil", "--links", 3, "--end", 0.5, "--frames", 9, "--formulation", "kane"
    assert drew("scene", gif, *how) == [("moved", "snake[3]", "kane", 0.5, 9), frames]
    assert drew("scene", svg) == [("snake[7]", "names", svg, False)]
    how = "--scene", "chain-pendulum", "--links", 4, "--dark"
    assert drew("scene", svg, *how) == [("chain-pendulum[4]", "names", svg, True)]
    assert drew("structure", svg) == [(("snake[7]", "au"), svg, False)]
    how = "--formulation", "kane", "--links", 5, "--dark"
    assert drew("structure", svg, *how) == [(("snake[5]", "kane"), svg, True)]


# ---- Studies -------------------------------------------------------------------------------------


def test_options_of_studies_read_lists_and_ranges_of_links_alone():
    assert study._whole("links", ["2..4", "3,7"]) == [2, 3, 4, 7]
    assert study._whole("links", []) is study._whole("links", None) is None
    assert study._whole("other", ["2,3"]) == [2, 3] and study._whole("other", []) is None
    with pytest.raises(InputError):
        study._whole("other", ["2..4"])


def test_an_interrupted_study_says_what_it_kept_and_with_which_words_it_goes_on(capsys):
    def interrupted(*given: Any, **how: Any) -> Any:
        raise KeyboardInterrupt

    one: Any = SimpleNamespace(run=interrupted)
    goes_on = (
        "interrupted: 'r.db' has all cells that were finished; the same command{} goes on with "
        "the others\n"
    )
    for records, fresh, said in (
        (None, False, "interrupted: nothing is kept without a file of records\n"),
        (Path("r.db"), False, goes_on.format("")),
        (Path("r.db"), True, goes_on.format(" without --fresh")),
    ):
        with pytest.raises(typer.Exit) as stop:
            study._run_study(one, records, fresh, {})
        assert stop.value.exit_code == 130
        assert capsys.readouterr().out == said


@pytest.mark.parametrize("alarm", [False, True])
def test_a_study_writes_prints_says_and_exits_by_its_alarm(alarm, monkeypatch, capsys, tmp_path):
    found = [Record("x", {})]
    order: list[Any] = []

    def noting(name: str, value: Any) -> Any:
        return lambda *given: (order.append((name, given[0] is found)), value)[1]

    one: Any = SimpleNamespace(
        run=lambda records, fresh, **options: (order.append((records, fresh, options)), found)[1],
        write=noting("write", [tmp_path / "b.md"]),
        document=noting("document", {"a": 1}),
        tables=noting("tables", []),
        remarks=noting("remarks", ["First.", "Second."]),
        alarm=noting("alarm", alarm),
    )
    code = 0
    try:
        study._run(one, Path("r.db"), True, tmp_path / "a.json", tmp_path, links=[3])
    except typer.Exit as stop:
        code = stop.exit_code
    assert code == alarm
    names = "write", "document", "tables", "remarks", "alarm"
    assert order == [(Path("r.db"), True, {"links": [3]}), *((name, True) for name in names)]
    said = capsys.readouterr().out.splitlines()
    assert said == ["First.", "Second.", f"written: {tmp_path / 'b.md'}, {tmp_path / 'a.json'}"]
    assert '"a": 1' in (tmp_path / "a.json").read_text(encoding="utf-8")
    order.clear()
    if not alarm:
        study._run(one, None, False, None, None)
        assert [x[0] for x in order] == [None, "tables", "remarks", "alarm"]
        assert "written" not in capsys.readouterr().out


def test_an_option_that_is_no_number_is_told_what_it_should_be(monkeypatch, capsys):
    assert run("simulate", "--end", "1", "--max-steps", "many", monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert "--max-steps" in error and "unable to parse" not in error


def test_a_campaign_without_a_failure_keeps_an_empty_file_that_replays(
    tmp_path, monkeypatch, capsys
):
    kept = tmp_path / "k.json"
    words = "fuzz", "--scene", "sleigh", "--examples", "1", "--engine", "none", "--claim", "bias"
    monkeypatch.setattr("eomcheck.supervisor.can_supervise", lambda: False)
    assert run(*words, "--no-climb", "--keep", str(kept), monkeypatch=monkeypatch) == 0
    assert kept.read_text().split() == ["[", "]"]
    assert run("fuzz", "--replay", str(kept), monkeypatch=monkeypatch) == 0
    assert "holds no failures" in capsys.readouterr().out


def test_a_name_like_an_imported_module_is_no_suggestion(tmp_path, monkeypatch, capsys):
    own = tmp_path / "own_words.py"
    own.write_text("import numpy as np\n")
    with pytest.raises(InputError, match=r"has no 'nope'$"):
        eomcheck.check(f"{own}:nope")
