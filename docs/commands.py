"""The page of all commands, from the command line itself: arguments, options, defaults."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer

from eomcheck import cli
from eomcheck.cli.application import option_label
from eomcheck.cli.study_commands import GROUPS, command_of
from eomcheck.lab.show.table import escaped, markdown_table

HELP = "--help"
OPTION = r"(?<![\w`-])--[a-z][a-z-]*(?![^`]*`)"
"""An option in a sentence that is not code already."""

EXAMPLES = {
    "eomcheck check": "check docs/guides/cart.py --examples 2",
    "eomcheck validate": "validate --scene sleigh --examples 2",
    "eomcheck prove": "prove --links 1 --examples 1 --seed 1",
    "eomcheck list": "list formulations",
    "eomcheck simulate": "simulate paper --end 0.01 --formulation kane,au",
    "eomcheck acceleration": "acceleration pattern --links 60 --speeds 1,0.5",
    "eomcheck constraints": "constraints --scene four-bar-chain",
    "eomcheck bench rhs": "bench rhs --scene sleigh --repeats 1 --formulation kane,au",
    "eomcheck bench differentiation": "bench differentiation --repeats 1 --formulation au",
    "eomcheck bench tolerance": "bench tolerance --links 1 --examples 2",
    "eomcheck study operations": "study operations --links 2..4",
    "eomcheck study accuracy": "study accuracy --links 1..2 --examples 2",
    "eomcheck study agreement": "study agreement --links 1..2 --per-size 2",
}
"""Commands that take seconds, by their words; `tests/cli/test_widths.py` runs each."""


def all_commands() -> Iterator[tuple[str, Any, Any]]:
    """Yield the words of each command, the command, and its context; groups before their own."""
    yield from _below(typer.main.get_command(cli.app), "eomcheck", None)


def _below(command: Any, name: str, parent: Any) -> Iterator[tuple[str, Any, Any]]:
    if parent is not None and name in GROUPS.get(parent.info_name, ()):
        command = command_of(name, figure_only=parent.info_name == "draw")
    context = type(command).context_class(command, info_name=name, parent=parent)
    yield context.command_path, command, context
    if hasattr(command, "list_commands"):
        for key in command.list_commands(context):
            yield from _below(command.get_command(context, key), key, context)


def command_reference() -> str:
    """Return a section for each command: its usage, its help, and a table of its options."""
    sections = []
    for path, command, context in all_commands():
        if hasattr(command, "list_commands"):
            continue
        usage = " ".join(command.get_usage(context).split()).removeprefix("Usage: ")
        records = [x for p in command.get_params(context) if (x := p.get_help_record(context))]
        rows = [
            (f"`{option_label(name)}`", _sentence(text))
            for name, text in records
            if HELP not in name
        ]
        text = "\n\n".join(map(_sentence, str(command.help).split("\n\n")))
        options = "```{rst-class} rows\n```\n\n" + markdown_table(("option", "meaning"), rows)
        example = f"```console\n$ eomcheck {EXAMPLES[path]}\n```\n\n" if path in EXAMPLES else ""
        sections.append(f"## {path}\n\n{text}\n\n```text\n{usage}\n```\n\n{example}{options}")
    return "\n\n".join(sections)


def _sentence(text: str) -> str:
    """A help text without line breaks, in a cell of a table; code in it stays code."""
    return re.sub(OPTION, r"`\g<0>`", escaped(" ".join(text.split())).replace("\\`", "`"))


def options_of() -> dict[str, set[str]]:
    """Return the options that each command has, by its words."""
    return {
        path: {
            *(
                option
                for p in command.get_params(context)
                for option in (*p.opts, *p.secondary_opts)
            ),
            HELP,
            "-h",
        }
        for path, command, context in all_commands()
    }
