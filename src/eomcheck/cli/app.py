"""Command line application: its help, exit codes and usage errors; commands register here."""

from __future__ import annotations

import re
from collections.abc import Sequence
from shutil import get_terminal_size
from textwrap import wrap
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from eomcheck import __version__
from eomcheck.errors import did_you_mean

EXIT_CODES = {
    0: "all claims hold, or what was asked for is done",
    1: "a claim fails, a motion does not reach its end, a formulation refuses, "
    "libraries differ or one gives no answer (`compare`), a constraint is redundant "
    "(`constraints`), code that is not ours ends its process, or gives no answer when it is called",
    2: "bad input, an import that raises, exits or gives no answer, a missing library, nothing "
    "decided about any claim (`validate`), library or engine (`compare`, `validate --engine`), or "
    "results that could not be written",
    130: "interrupted (Ctrl-C, SIGTERM); what was found is kept",
}

QUESTION = "are equations of motion right, how accurate are they, what do they cost?"

QUICK_START = {
    "your functions: M, bias and so on": "eomcheck.check(...)",
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


def _option_label(name: str) -> str:
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
        """Write the help with the labels of `_option_label`."""
        write = formatter.write_dl
        formatter.write_dl = lambda rows, **how: write(
            [(_option_label(n), re.sub(r" +(?=\[(?:default|required))", " ", x)) for n, x in rows],
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

    The message is one sentence in one line, or the help of a group whose command is missing. The
    parser is part of typer in newer versions and of click in older ones, so its errors are
    recognized by their attributes.
    """
    if not hasattr(error, "format_message"):
        return None
    context: Any = getattr(error, "ctx", None)
    text: str = error.format_message()  # type: ignore[attr-defined]
    if type(error).__name__ == "NoArgsIsHelpError":
        return text
    option, near = getattr(error, "option_name", None), getattr(error, "possibilities", None)
    if near and option:
        text = f"{error.message}{did_you_mean(option, near)}"  # type: ignore[attr-defined]
    for parsed, expected in PARSED.items():
        text = text.replace(parsed, expected)
    command = "eomcheck" if context is None else context.command_path
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
