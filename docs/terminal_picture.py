"""Picture of a command's output on a terminal, as an SVG that loads nothing.

    python docs/terminal_picture.py --until passed docs/figures/first-failure.svg \\
        -- eomcheck check half.py

The command, one of a Python module, runs in docs/guides on a terminal of 100 columns. Lines from
the first one on that begins with the text of --until are left out.
"""

from __future__ import annotations

import argparse
import os
import pty
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

COLUMNS = 100
FOLDER = Path(__file__).parent / "guides"


def colored_output(command: list[str], until: str) -> str:
    """Return the standard output of a command as on a terminal, up to a line."""
    ours, theirs = pty.openpty()
    size = {"COLUMNS": str(COLUMNS), "LINES": "100", "TERM": "xterm-256color"}
    program = [sys.executable, "-m", *command]
    how: dict[str, Any] = {"cwd": FOLDER, "env": os.environ | size, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(program, stdout=theirs, **how):
        os.close(theirs)
        parts = []
        while part := _read(ours):
            parts.append(part)
    text = b"".join(parts).decode("utf-8").replace("\r\n", "\n")
    return text.partition(f"\n{until}")[0].rstrip() if until else text.rstrip()


def _read(terminal: int) -> bytes:
    """Return what a terminal has to say, nothing at its end."""
    try:
        return os.read(terminal, 1 << 16)
    except OSError:  # Linux: the other side is closed
        return b""


def picture(command: list[str], text: str) -> str:
    """Return the SVG of a prompt with a command and of its output."""
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        console = Console(record=True, width=COLUMNS, file=nowhere, force_terminal=True)
        console.print(Text("$ " + " ".join(command), style="bold"))
        console.print(Text.from_ansi(text))
        svg = console.export_svg(title=command[0], unique_id="terminal")
    # A font is loaded from elsewhere otherwise; the next one of the list is on every machine.
    return re.sub(r"@font-face \{.*?\}\n", "", svg, flags=re.S)


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--until", default="", help="begin of the first line left out")
    parser.add_argument("command", nargs="+")
    asked = parser.parse_args()
    text = colored_output(asked.command, asked.until)
    asked.file.write_text(picture(asked.command, text), encoding="utf-8")


if __name__ == "__main__":
    main()
