"""Command line application: its help, exit codes and usage errors, and options of many commands.

Commands register here. Completion reads the keys of scenes, formulations and engines from the
source files as text: nothing is imported for it, so it takes no longer than the command line takes
to start.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.metadata import entry_points
from pathlib import Path
from shutil import get_terminal_size
from tempfile import TemporaryDirectory
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from eomcheck import __version__, calls
from eomcheck.atomic_write import check_writable
from eomcheck.errors import (
    InputError,
    UnwrittenError,
    WorkerError,
    described_error,
    did_you_mean,
    whole_number,
)
from eomcheck.lab.option_parsing import (
    ISOLATED_HELP,
    ONE_HELP,
    SCENE_HELP,
    SET_HELP,
    no_more_than,
    parse_numbers,
    parse_parameters,
    split_list,
)

if TYPE_CHECKING:
    from eomcheck.lab.store.record_file import Records
    from eomcheck.mechanics.scene import Scene


# ---- Help, exit codes and usage errors -----------------------------------------------------------

EXIT_CODES = {
    0: "all claims hold, or what was asked for is done",
    1: "a claim fails, a motion does not reach its end, a formulation refuses, "
    "libraries differ or one gives no answer (`compare`), a constraint is redundant "
    "(`constraints`), code that is not ours ends its process or gives no answer, its import "
    "included",
    2: "bad input, an import that raises or exits, a missing library, nothing decided about any "
    "claim (`check`, `validate`), library or engine (`compare`, `validate --engine`), or results "
    "that could not be written",
    130: "interrupted (Ctrl-C, SIGTERM); what was found is kept",
}

QUESTION = "are equations of motion right, how accurate are they, what do they cost?"

QUICK_START = {
    "your functions: M, bias and so on": "eomcheck check FILE.py",
    "your engine": "eomcheck validate --engine FILE:CLASS",
    "a scene: built-in, yours, a URDF": "eomcheck validate --scene SCENE",
    "all at once": "eomcheck validate",
    "all commands": "eomcheck --help",
}
"""Starting point of a user -> the call or command to type."""

MAX_WIDTH, MAX_GREETING = 80, 100
"""Largest width of help, and of the quick start, columns, on terminals of any width."""


OLD_FORM = "OLD-FORM"
"""Placeholder of an argument that is accepted as in an older release, and not shown."""

VALUES = {"int": "N", "float": "X", "str": "TEXT", "path": "FILE"}
"""Typer's name of a value type -> its name in help; some option names override it."""
FOLDERS = ("--figures", "--folder", "--references", "--suite")


def option_label(name: str) -> str:
    """Return the help label of an option or argument: `--links N`, not `--links <int>`."""
    match = re.fullmatch(r"(.+) <(.+)>", name)
    if match is None:
        return name
    option, kind = match.groups()
    if not option.startswith("-"):
        return option
    return f"{option} {'FOLDER' if option in FOLDERS else VALUES.get(kind, kind.upper())}"


class Command(TyperCommand):
    """Command whose help names values by their meaning, not by their Python types."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help with the labels of `option_label`."""
        write = formatter.write_dl
        formatter.write_dl = lambda rows, **how: write(
            [(option_label(n), re.sub(r" +(?=\[(?:default|required))", " ", x)) for n, x in rows],
            **how,
        )
        super().format_help(ctx, formatter)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the pieces of the usage line."""
        pieces = super().collect_usage_pieces(ctx)
        plain = [re.sub(r"^\{(.*)\}|^\[(\[.*\])\]$", r"\1\2", one) for one in pieces]
        return [one.replace("[[SCENE]]...", "[SCENE]") for one in plain if OLD_FORM not in one]


class CommandLine(typer.Typer):
    """Group of commands, each of class `Command`."""

    def command(self, name: str | None = None, **how: Any) -> Any:
        """Return a decorator that adds a command."""
        return super().command(name, cls=Command, **how)


class CommandGroup(TyperGroup):
    """Command group whose help quotes the first sentence of each command in full."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the table of commands with their first sentences."""
        rows = [(name, _first_sentence(self.get_command(ctx, name))) for name in self.names(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def names(self, ctx: Any) -> list[str]:
        """Return the names of the visible commands."""
        commands = ((name, self.get_command(ctx, name)) for name in self.list_commands(ctx))
        return [name for name, command in commands if command and not command.hidden]

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the exit codes below all commands."""
        if ctx.parent is None:
            with formatter.section("Exit codes"):
                formatter.write_dl([(str(code), what) for code, what in EXIT_CODES.items()])


def _first_sentence(command: Any) -> str:
    return (command.help or "").split("\n\n")[0].replace("\n", " ").strip()


PARSED = {
    "Input should be a valid integer, unable to parse string as an integer": (
        "expected a whole number"
    ),
    "Input should be a valid number, unable to parse string as a number": "expected a number",
}
"""Message of the parser on a value -> what is expected."""


def usage_error(error: BaseException) -> str | None:
    """Return the message for words that are not a command line; None for any other error.

    The message is one sentence in one line. The parser is part of typer in newer versions and of
    click in older ones, so its errors are recognized by their attributes.
    """
    if not hasattr(error, "format_message"):
        return None
    context: Any = getattr(error, "ctx", None)
    text: str = error.format_message()  # type: ignore[attr-defined]
    command = getattr(context, "command_path", "eomcheck")
    if type(error).__name__ == "NoArgsIsHelpError":
        group = context.command
        text = f"{group.name} needs a command: {', '.join(group.names(context))}"
    option, near = getattr(error, "option_name", None), getattr(error, "possibilities", None)
    if near and option:
        text = f"{error.message}{did_you_mean(option, near)}"  # type: ignore[attr-defined]
    problems: Any = getattr(error.__cause__, "errors", list)()
    for parsed, expected in PARSED.items():
        value = "".join(f"{problem['input']!r}, " for problem in problems)
        text = text.replace(parsed, f"{value}{expected}")
    return f"eomcheck: {' '.join(text.split()).rstrip('.')} (see {command} --help)"


OPTION_NAMES = {"t_end": "end", "u": "speeds"}
"""Parameter of a function, without an index -> the option that sets it, if named otherwise."""


def as_typed(message: str, words: Sequence[str]) -> str:
    """Return an error that begins with "links = 0" with the option as it was typed: "--links 0".

    Args:
        message: message of the error, which names a parameter of a function.
        words: command line.
    """
    name, equals, problem = message.partition(" = ")
    name = OPTION_NAMES.get(name.partition("[")[0], name)
    option = f"--{name.replace('_', '-')}"
    typed = any(word == option or word.startswith(f"{option}=") for word in words)
    return f"{option} {problem}" if equals and typed else message


def help_width(most: int = MAX_WIDTH) -> int:
    """Return the width of help, columns: that of the terminal, or COLUMNS, less a margin."""
    return min(get_terminal_size().columns, most) - 2


app = CommandLine(
    name="eomcheck",
    cls=CommandGroup,
    help="Check equations of motion of multibody systems: are they right, how accurate are they, "
    "what do they cost?",
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"eomcheck {__version__}")
        raise typer.Exit


def _print_quick_start() -> None:
    width, left = help_width(MAX_GREETING), max(map(len, QUICK_START)) + 3
    print("\n".join(wrap(f"eomcheck {__version__}: {QUESTION}", width)), end="\n\n")
    beside = left + max(map(len, QUICK_START.values())) <= width
    for have, typed in QUICK_START.items():
        print(f"{have:<{left}}{typed}" if beside else f"{have}\n  {typed}")


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print version."),
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        _print_quick_start()


# ---- Shell completion ----------------------------------------------------------------------------

ROOT = Path(__file__).parents[1]

KEY_PATTERNS = {
    "scene": ("scenes", r'^    key = "([\w-]+)"'),
    "formulation": ("formulations", r'^    key="(\w+)",'),
    "engine": ("engines", r'^    key = "(\w+?)(?:_file|_mjcf|_sdf)?"$'),
    "robot": ("", r'^    "(\w+)": lambda links'),
    "claim": ("claims", r'^(?:@(?:case_|tree_)?claim\(\s*|CLAIMS\[)"([\w-]+)"'),
}
"""Kind of key -> folder of its source files, and the pattern of a key in one."""


def declared_keys(word: str) -> list[str]:
    """Return the keys of one kind of `KEY_PATTERNS`: built-in, and announced by packages."""
    folder, pattern = KEY_PATTERNS[word]
    files = (file.read_text(encoding="utf-8") for file in sorted((ROOT / folder).glob("*.py")))
    found = (key for text in files for key in re.findall(pattern, text, re.MULTILINE))
    built_in = list(dict.fromkeys(found))
    if word == "claim":  # one for each quantity of engines
        text = (ROOT / "evaluation" / "conformance.py").read_text(encoding="utf-8")
        methods = re.findall(r'^            \*\("(\w+)", "', text, re.MULTILINE)
        built_in += [f"engine-{method.replace('_', '-')}" for method in methods]
    announced = [point.name for point in entry_points(group=f"eomcheck.{word}s")]
    return [*built_in, *announced]


def completer(*words: str, more: Sequence[str] = ()) -> Callable[[str], list[str]]:
    """Return the shell completion of a key, or of the last of several keys with commas between.

    Args:
        words: kinds of keys, see `KEY_PATTERNS`.
        more: other names to complete.
    """

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        known = [key for word in words for key in declared_keys(word)]
        names = (name for name in (*known, *more) if name.startswith(last))
        return [f"{before}{comma}{name}" for name in names]

    return complete


# ---- Types of options, and checks ----------------------------------------------------------------

SUITE = Path("validation")
REFERENCES = SUITE / "references"


def scene_option(text: str = ONE_HELP, *more: str) -> Any:
    """Return an option that takes a scene or a kind of scene."""
    keys = completer("scene", "robot", more=more)
    return typer.Option(metavar="SCENE", help=text, autocompletion=keys)


def keys_option(text: str, *words: str, more: Sequence[str] = ()) -> Any:
    """Return an option that takes several keys: "a,b", or repeated."""
    keys = completer(*words, more=more)
    return typer.Option(metavar="KEY,KEY", help=text, callback=split_list, autocompletion=keys)


def executor_option(default: str = "") -> Any:
    """Return an option that takes an executor; `default` describes a default of None."""
    text = "Where to compute: local, local:PROCESSES or dask:ADDRESS."
    return typer.Option(metavar="PLACE", help=f"{text} [default: {default}]" if default else text)


def checked_seed(seed: int | None) -> int | None:
    """Return the seed, one that is not negative, or None."""
    return None if seed is None else whole_number("seed", seed, 0)


def seed_option(text: str) -> Any:
    """Return an option that takes the seed of draws."""
    return typer.Option(help=text, callback=checked_seed)


SceneClassOption = Annotated[
    str,
    typer.Option(metavar="SCENE", help=SCENE_HELP, autocompletion=completer("scene", more=["all"])),
]
DEFAULT_SCENE = "paper"
"""Default scene of commands about one scene."""
SceneOption = Annotated[str, scene_option()]
OptionalSceneOption = Annotated[str | None, scene_option()]
Links = Annotated[int | None, typer.Option(help="Number of links, of scenes that have one.")]
SetOption = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help=SET_HELP)]
FormulationOption = Annotated[
    str, typer.Option(metavar="KEY", help="Formulation.", autocompletion=completer("formulation"))
]
Seed = Annotated[int, seed_option("Seed of the draws.")]
ExecutorOption = Annotated[str, executor_option()]
Formulations = Annotated[
    list[str] | None,
    keys_option("Formulation, or several: a,b. [default: all]", "formulation"),
]
Engines = Annotated[
    list[str] | None,
    keys_option(
        "Engine to compare with, several: a,b, or your own to check: FILE.py:CLASS; none for no "
        "engine. [default: those that no extra installs]",
        "engine",
        more=["none"],
    ),
]
IsolatedOption = Annotated[bool, typer.Option("--isolated", help=ISOLATED_HELP)]
Claims = Annotated[
    list[str] | None, keys_option("Claim to check, or several: a,b. [default: all]", "claim")
]
ReportedClaims = Annotated[
    list[str] | None, keys_option("Claim to report, or several: a,b. [default: all]", "claim")
]
References = Annotated[Path, typer.Option(help="Folder of the reference solutions.")]
OldRecords = Annotated[Path | None, typer.Argument(metavar=OLD_FORM, hidden=True)]
Fresh = Annotated[bool, typer.Option("--fresh", help="Measure everything anew.")]
Json = Annotated[Path | None, typer.Option("--json", help="Write the results to this file.")]
DeviationsOption = Annotated[
    Path | None,
    typer.Option(
        "--deviations",
        metavar="FILE",
        help="TOML file of known deviations of engines: exit code 1 for a difference that it does "
        "not declare, and for a declared one that is not observed; 0 otherwise.",
    ),
]
RecordsOption = Annotated[
    Path | None,
    typer.Option(
        "--records",
        help="Keep the results in this SQLite file, made or continued, for `eomcheck report`.",
    ),
]


def _patient(seconds: float) -> float:
    calls.set_patience(calls.checked_patience(seconds))
    return seconds


Patience = Annotated[
    float,
    typer.Option(
        metavar="SECONDS",
        callback=_patient,
        help="How long a call of your own code or of an outside library may take; the first call "
        f"of a function, and an import, {calls.FIRST} times as long.",
    ),
]


def selected_scene(name: str, links: int | None, settings: list[str] | None) -> Scene:
    """Return the scene selected by `--scene`, `--links` and `--set`.

    Raises:
        InputError: there is none, see `eomcheck.scene_lookup.scene_named`.
    """
    parameters = parse_parameters(settings)
    from eomcheck.scene_lookup import scene_named

    return scene_named(name, no_more_than(links), parameters)


SpeedsOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="X,X",
        help="Generalized speeds at the start: 1,0.5, or repeated. [default: the scene's]",
    ),
]


def selected_speeds(scene: Scene, texts: list[str] | None) -> list[float] | None:
    """Return p generalized speeds, or None by default.

    Raises:
        InputError: a text is no number, or there are not p of them.
    """
    if not texts:
        return None
    speeds = parse_numbers("speeds", texts)
    if len(speeds) != scene.p:
        raise InputError(f"speeds = {speeds}: {scene.name} has {scene.p}, expected so many numbers")
    return speeds


def selected_engines(names: list[str] | None, isolated: bool = False) -> list[str] | None:
    """Return the engines named by `--engine`: an empty list for "none", None by default.

    Args:
        names: names that are given.
        isolated: whether optional libraries run in processes and environments of their own.

    Raises:
        InputError: they do, and no engine is named: none that takes part by default is optional.
    """
    if names is None:
        check_used("without --engine", isolated=isolated)
        return None
    if not isolated or names == ["none"]:
        return [] if names == ["none"] else names
    from eomcheck.engines import isolated_names

    return isolated_names(names)


def check_used(condition: str, **options: object) -> None:
    """Raise InputError if an option is set that has no effect under a condition.

    Args:
        condition: requirement that is not met, such as "without --examples".
        options: name -> value, None or False if it is not set.
    """
    for name, value in options.items():
        if value is not None and value is not False:
            raise InputError(f"--{name.replace('_', '-')} has no effect {condition}")


def records_or_none(path: Path | None) -> AbstractContextManager[Records | None]:
    """Return a context manager of the Records in a file; of None without a file."""
    if path is None:
        return nullcontext()
    from eomcheck.lab.store.record_file import Records

    return Records(path)


@contextmanager
def records_to_report(path: Path | None, page: Path | None) -> Iterator[Records | None]:
    """Yield the Records in a file; without a file but for a page, those in a temporary file.

    Raises:
        EngineError: there is to be a page, and a library that draws it is not installed.
    """
    if page is not None:
        from eomcheck.lab.report.report_formats import check_installed

        check_installed()
    spare = TemporaryDirectory() if page is not None and path is None else nullcontext()
    with spare as folder, records_or_none(Path(folder) / "r.db" if folder else path) as records:
        yield records


class CommandEnd:
    """The end of a long command: whether it was interrupted, and the errors on its way.

    Tables of what is done are printed before `conclude` raises them.
    """

    def __init__(self):
        self.interrupted = False
        self.lost: WorkerError | None = None
        self.unwritten: InputError | None = None

    @contextmanager
    def collected(self, *unwritten: type[InputError]) -> Iterator[None]:
        """Keep an interrupt, a lost worker or an unwritten file, named by `unwritten` too."""
        try:
            yield
        except KeyboardInterrupt:
            self.interrupted = True
        except WorkerError as error:
            self.lost = error
        except (UnwrittenError, *unwritten) as error:
            self.unwritten = self.unwritten or error

    def conclude(self, written: Path | Sequence[Path] | None, failed: bool) -> None:
        """Print the names of written files, and raise what ends the command otherwise than by 0."""
        if self.unwritten is not None:
            raise self.unwritten
        if written:
            files = [written] if isinstance(written, Path) else written
            print(f"written: {', '.join(map(str, files))}")
        if self.interrupted:
            raise typer.Exit(130)
        if self.lost is not None:
            raise self.lost
        if failed:
            raise typer.Exit(1)


def check_output(path: Path | None, records: list[Path]) -> None:
    """Raise InputError unless `path` can be written and is none of the files of records.

    Files that do not exist yet are compared by name.
    """
    check_writable(path)
    if path is None:
        return
    for file in records:
        both_exist = path.exists() and file.exists()
        if path.samefile(file) if both_exist else path.resolve() == file.resolve():
            raise InputError(f"{str(path)!r} holds the records themselves")


def raise_unread(unread: list[str]) -> None:
    """Raise InputError for unreadable content, if any; called after the readable part is shown."""
    if unread:
        more = f" (and {len(unread) - 1} more)" if len(unread) > 1 else ""
        raise InputError(f"not all is shown: {unread[0]}{more}")


def check_folder(path: Path | None) -> None:
    """Make a folder to write into, unless it is there or None; the folder around it must be there.

    Raises:
        InputError: that one does not exist, or the folder is a file or cannot be made.
    """
    if path is None or path.is_dir():
        return
    if path.exists():
        raise InputError(f"{str(path)!r} is a file, expected a folder")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{str(path)!r} cannot be made: there is no folder {str(path.parent)!r}")
    try:
        path.mkdir()
    except OSError as error:
        raise InputError(f"{str(path)!r} cannot be made: {described_error(error)}") from error


def check_figure(path: Path | None, *further: str) -> None:
    """Raise InputError unless `path` is None, or can be written and has the suffix of a figure.

    Args:
        path: the file.
        further: suffixes that are allowed beside those of all figures.
    """
    *suffixes, last = (".png", ".svg", ".pdf", *further)
    if path is not None and path.suffix not in (*suffixes, last):
        raise InputError(f"{str(path)!r}: a figure is written as {', '.join(suffixes)} or {last}")
    check_writable(path)
