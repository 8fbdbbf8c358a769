"""Size, call paths and wording of the source, measured on this checkout or on others.

    python -m tests.house lines [ROOT ...]
    python -m tests.house walk [ROOT ...] [--only NAME]
    python -m tests.house words [ROOT ...] [--list] [--glossary]

ROOT is the folder of a checkout, by default this one; `git worktree add` makes those of other
commits. A room is a top-level folder of `src/eomcheck`; a file beside these folders is a room too.

Lines: each line of a file is of one sort, the first that fits: docstring (also the string below an
attribute), import, code (it holds a token, be it a decorator's or one closing bracket), comment,
blank. A blank line inside a docstring belongs to the docstring.

Walks: the Python frames of the package that one call enters, by `sys.setprofile`. Each walk has a
process of its own, where only what starts it is imported: "cold" is the first call there, and the
bodies of modules that it imports count; "warm" repeats it with every cache filled. Crossings are
calls out of one room into another (the caller is the frame of the package below on the stack);
changes are calls and returns whose frame is in another room than that of the event before.

Words: of docstrings and comments, and of the documentation without code blocks and inline code. The
theory, the scenes' pages and generated figures are left out.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import io
import json
import keyword
import os
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent.parent
PACKAGE = Path("src/eomcheck")


def files_of(root: Path) -> list[Path]:
    """Source files of the package in a checkout."""
    return sorted((root / PACKAGE).rglob("*.py"))


def room_of(path: Path | str) -> str:
    """Top-level folder of a path relative to the package, or the file beside these folders."""
    return Path(path).parts[0]


# ---- Lines ---------------------------------------------------------------------------------------

SORTS = ("code", "docstrings", "imports", "comments", "blank")
LAYOUT = {
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
    tokenize.COMMENT,
}


def docstrings_of(tree: ast.Module) -> Iterator[ast.Constant]:
    """Strings that are statements: docstrings, and those below attributes."""
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str()) as string):
                yield string


def tokens_of(source: str) -> Iterator[tokenize.TokenInfo]:
    """Python tokens of a source text."""
    return tokenize.generate_tokens(io.StringIO(source).readline)


def sorts_of(source: str) -> Counter[str]:
    """Number of lines of each sort in a source text."""
    tree = ast.parse(source)
    imports = [x for x in ast.walk(tree) if isinstance(x, ast.Import | ast.ImportFrom)]
    sort: dict[int, str] = {}
    for token in tokens_of(source):
        if token.type not in LAYOUT:
            sort |= dict.fromkeys(range(token.start[0], token.end[0] + 1), "code")
        elif token.type == tokenize.COMMENT:
            sort.setdefault(token.start[0], "comments")
    for name, nodes in (("imports", imports), ("docstrings", docstrings_of(tree))):
        for node in nodes:
            sort |= dict.fromkeys(range(node.lineno, (node.end_lineno or node.lineno) + 1), name)
    return Counter(sort.get(i + 1, "blank") for i in range(len(source.splitlines())))


def print_lines(root: Path) -> None:
    """Print a table of lines: a row for each room, and the total."""
    rooms: dict[str, Counter[str]] = {}
    for path in files_of(root):
        counts = sorts_of(path.read_text(encoding="utf-8")) + Counter(files=1)
        for name in (room_of(path.relative_to(root / PACKAGE)), "total"):
            rooms[name] = rooms.get(name, Counter()) + counts
    rooms["total"] = rooms.pop("total")
    print(f"{'room':20}{'files':>6}{'lines':>8}" + "".join(f"{sort:>12}" for sort in SORTS))
    for name, counts in rooms.items():
        lines = sum(counts[sort] for sort in SORTS)
        row = "".join(f"{counts[sort]:12}" for sort in SORTS)
        print(f"{name:20}{counts['files']:6}{lines:8}{row}")


# ---- Walks ---------------------------------------------------------------------------------------


class Event(NamedTuple):
    """A call (or the resumption of a generator), or a return, in a file of the package."""

    call: bool
    file: str


class Walk(NamedTuple):
    """Measures of a call path."""

    files: int
    rooms: int
    depth: int
    crossings: int
    changes: int
    calls: int


def walk_of(events: Iterable[Event]) -> Walk:
    """Measures of the events of one call, in their order."""
    stack: list[str] = []
    files: set[str] = set()
    depth = crossings = changes = calls = 0
    last = None
    for event in events:
        room = room_of(event.file)
        changes += last not in (None, room)
        last = room
        if not event.call:
            stack.pop()
            continue
        calls += 1
        crossings += bool(stack) and stack[-1] != room
        stack.append(room)
        files.add(event.file)
        depth = max(depth, len(stack))
    return Walk(len(files), len({*map(room_of, files)}), depth, crossings, changes, calls)


def profiled(function: Callable[[], Any], package: Path) -> list[Event]:
    """Events in the files of a package while a function runs."""
    prefix, events = f"{package}{os.sep}", []

    def record(frame, event: str, argument: object) -> None:
        file = frame.f_code.co_filename
        if event in ("call", "return") and file.startswith(prefix):
            events.append(Event(event == "call", file.removeprefix(prefix)))

    sys.setprofile(record)
    try:
        function()
    finally:
        sys.setprofile(None)
    return events


def first_of(*names: str) -> Any:
    """The first of "module:attribute" that exists: names differ between commits."""
    for name in names:
        module, _, attribute = name.partition(":")
        try:
            return getattr(importlib.import_module(module), attribute)
        except (ImportError, AttributeError):
            continue
    raise SystemExit(f"none of {', '.join(names)} exists")


def scene_walk(folder: Path) -> Callable[[], Any]:
    """One moving state of the sleigh, one claim, one formulation, no engine, to its verdict."""
    check = first_of("eomcheck:check_state", "eomcheck:check")
    scene = first_of("eomcheck.scenes:SCENES")["sleigh"].example()
    state = [0.1, 0.2, 0.3], first_of("eomcheck:velocity")(scene, [0.1, 0.2, 0.3], [0.4, 0.5])
    names = {"formulations": ["au"], "engines": [], "claims": ["constraint-acceleration"]}
    return lambda: check(scene, *state, **names)


def function_walk(folder: Path) -> Callable[[], Any]:
    """One state of user-supplied functions, one claim, to its verdict."""
    import numpy as np

    def mass(q):
        return np.diag(2 + np.cos(q))

    def bias(q, v):
        return -0.5 * np.sin(q) * v**2

    check = first_of("eomcheck.testing:check_functions")
    state = np.full(3, 0.3), np.full(3, 0.5)
    options = {"states": [state], "claims": ["bias-of-mass-matrix"]}
    return lambda: check(3, M=mass, bias=bias, **options)


URDF = """<robot name="arm">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial></link>
<link name="lower"><inertial><origin xyz="0 0 -0.4"/><mass value="0.8"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.01"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
<origin xyz="0 0 -1"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
</robot>
"""


def urdf_walk(folder: Path) -> Callable[[], Any]:
    """A URDF of two joints to the machine code of its right-hand side by Kane's method."""
    file = folder / "arm.urdf"
    file.write_text(URDF, encoding="utf-8")
    kernel_of = first_of("eomcheck.motion.right_hand_side:kernel_of")
    formulation = first_of("eomcheck.formulations:FORMULATIONS")["kane"]

    def run() -> None:
        from_urdf = first_of("eomcheck.scenes:from_urdf")
        kernel_of(from_urdf(file), formulation)

    return run


def study_walk(folder: Path) -> Callable[[], Any]:
    """The study of operations, one formulation at two sizes, to its figure and tables."""
    study = first_of("eomcheck.lab.studies:study_of")("operations")
    options = {"links": "3..4", "formulation": ["el"]}
    return lambda: study.write(study.run(**options), folder)


WALKS: dict[str, Callable[[Path], Callable[[], Any]]] = {
    "scene": scene_walk,
    "functions": function_walk,
    "urdf": urdf_walk,
    "study": study_walk,
}
CACHES = ("cold", "warm")


def measured_walks(name: str) -> dict[str, Walk]:
    """Measures of a walk in this process, cold and warm."""
    import eomcheck

    package = Path(str(eomcheck.__file__)).parent
    with TemporaryDirectory() as folder:
        call = WALKS[name](Path(folder))
        return {caches: walk_of(profiled(call, package)) for caches in CACHES}


def walks_in(root: Path, name: str) -> dict[str, Walk]:
    """Measures of a walk in a new process that imports the package of a checkout."""
    environment = {**os.environ, "PYTHONPATH": str(root / "src")}
    # With -P the folder of this file is no place to import from: it has a `numbers`.
    command = [sys.executable, "-P", str(Path(__file__).resolve()), "walk", "--process", name]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    last = done.stdout.splitlines()[-1]
    return {caches: Walk(*numbers) for caches, numbers in json.loads(last).items()}


def print_walks(root: Path, names: Iterable[str]) -> None:
    """Print a table of walks: two rows for each, cold and warm."""
    print(f"{'walk':12}{'caches':8}" + "".join(f"{field:>11}" for field in Walk._fields))
    for name in names:
        for caches, walk in walks_in(root, name).items():
            print(f"{name:12}{caches:8}" + "".join(f"{x:11}" for x in walk), flush=True)


# ---- Words ---------------------------------------------------------------------------------------


class Passage(NamedTuple):
    """A text without a break, and the place where it begins."""

    file: Path
    line: int
    text: str


NOUN = r"\b(?:Return|of|by|from|with|to)\s+what\b|\bWhat\b"
CLAUSES = {
    "what as a noun": re.compile(NOUN),
    "say, says, said": re.compile(r"\b(?:say|says|said)\b", re.IGNORECASE),
    "look(ed) at": re.compile(r"\b(?:look|looks|looked)\s+at\b", re.IGNORECASE),
    "tell, tells, told": re.compile(r"\b(?:tell|tells|told)\b", re.IGNORECASE),
}
"""Clauses to avoid, each with a limit of 0.5 per 1 000 words; a capital What begins a sentence."""
WIDER = {
    "  sentence with What": re.compile(r"\bWhat\b"),
    "  and what, is what": re.compile(r"\b(?:and|is)\s+what\b"),
    "  any what": re.compile(r"\bwhat\b", re.IGNORECASE),
    "  look without at": re.compile(r"\blook(?:s|ed|ing)?\b(?!\s+at\b)", re.IGNORECASE),
}
"""Clauses near those, without a limit."""


def comments_of(source: str) -> Iterator[tuple[int, str]]:
    """(line, text) of the comments; those on lines that follow each other are one text."""
    first, texts = 0, []
    for token in tokens_of(source):
        if token.type == tokenize.COMMENT:
            if texts and token.start[0] != first + len(texts):
                yield first, "\n".join(texts)
                texts = []
            first = first if texts else token.start[0]
            texts.append(token.string.lstrip("#: "))
    if texts:
        yield first, "\n".join(texts)


def source_passages(file: Path, source: str) -> Iterator[Passage]:
    """Docstrings and comments of a source text."""
    for node in docstrings_of(ast.parse(source)):
        yield Passage(file, node.lineno, str(node.value))
    for line, text in comments_of(source):
        yield Passage(file, line, text)


FENCE = re.compile(
    r"^(?P<before> *(?P<marks>`{3,}|~{3,}))(?P<kind>[^\n]*)\n(?P<body>.*?)^ *(?P=marks) *$",
    re.MULTILINE | re.DOTALL,
)
PROSE = {"{glossary}", "{note}", "{important}", "{tip}", "{warning}"}
"""Directives whose blocks are prose."""
CODE = re.compile(r"(?P<marks>`+)(?!`)(?:(?!\n\n).)+?(?<!`)(?P=marks)(?!`)|<!--.*?-->", re.DOTALL)


def without_code(text: str) -> str:
    """Markdown without code blocks, inline code and HTML comments; lines keep their numbers."""

    def emptied(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    def opened(match: re.Match[str]) -> str:
        return f"\n{match['body']}" if match["kind"].split(" ")[0] in PROSE else emptied(match)

    return CODE.sub(emptied, FENCE.sub(opened, text))


LEFT_OUT = {"theory", "scenes", "figures", "_build"}
"""Folders of `docs` whose words do not count."""


def documentation_passages(root: Path) -> Iterator[Passage]:
    """Pages of the documentation, the first page and the page for contributors."""
    docs = root / "docs"
    pages = (x for x in docs.rglob("*.md") if not LEFT_OUT & {*x.relative_to(docs).parts})
    for path in (root / "README.md", root / "CONTRIBUTING.md", *sorted(pages)):
        yield Passage(path.relative_to(root), 1, without_code(path.read_text(encoding="utf-8")))


def word_count(passages: Iterable[Passage]) -> int:
    """Number of words."""
    return sum(len(re.findall(r"\w+", passage.text)) for passage in passages)


def matches(pattern: re.Pattern[str], passages: Iterable[Passage]) -> Iterator[tuple[str, str]]:
    """(file:line, the line in which it stands) of each match."""
    for file, line, text in passages:
        for match in pattern.finditer(text):
            number = text.count("\n", 0, match.end())
            yield f"{file}:{line + number}", text.splitlines()[number].strip()


def print_clauses(passages: dict[str, list[Passage]], listed: bool) -> None:
    """Print how often each clause stands per 1 000 words."""
    counts = {name: word_count(texts) for name, texts in passages.items()}
    header = "".join(f"{f'{name} ({counts[name]})':>20}" for name in passages)
    print(f"{'per 1 000 words':24}{header}")
    for clause, pattern in (CLAUSES | WIDER).items():
        found = {name: list(matches(pattern, texts)) for name, texts in passages.items()}
        cells = (
            f"{1000 * len(x) / (counts[name] or 1):13.2f} {len(x):6}" for name, x in found.items()
        )
        print(f"{clause:24}" + "".join(cells))
        if listed and clause in CLAUSES:
            for place, line in (one for some in found.values() for one in some):
                print(f"    {place}: {line}")


class Private(NamedTuple):
    """A private word: the field's word for it, a pattern in prose, parts of identifiers."""

    field: str
    prose: str
    parts: str = ""


GLOSSARY = {
    "look": Private("check, evaluate", r"look(?:s|ed|ing)? at", "look looks looked"),
    "not looked at": Private("skipped", r"not (?:be )?looked at"),
    "told, tell": Private("reported, resolved", r"tell|tells|told", "told tell tells untold"),
    "say, said": Private("result, message", r"say|says|said", "say says said"),
    "moved, moves": Private("perturbed", r"move[sd]?", "move moved moves"),
    "still, unmoved": Private("unperturbed, exact", r"unmoved|still", "still unmoved"),
    "copies, together": Private(
        "perturbed samples, batch", r"cop(?:y|ies)|together", "copies together copied"
    ),
    "list, listed": Private("trace, tape", r"lists?|listed", "listed"),
    "lane": Private("batch element, SIMD lane", r"lanes?", "lane lanes"),
    "place": Private("index, offset, backend", r"places?", "place places"),
    "climb, height": Private(
        "hill climbing, score", r"climb\w*|heights?", "climb climbs climbing height heights"
    ),
    "ration, unlifted": Private(
        "sampling rate, batchable", r"rations?|unlifted|liftable", "ration unlifted liftable lifted"
    ),
    "finds": Private("failure, counterexample", r"finds?", "find finds"),
    "on trial, subject": Private("under test", r"(?:on|of) trial|subjects?", "trial subject"),
    "somebody, ours": Private(
        "user-supplied, built-in", r"somebody(?:'s)?|ours|theirs", "somebody ours theirs"
    ),
    "made": Private("constructed", r"made", "made"),
    "given": Private("input", r"given", "given"),
    "found": Private("result", r"found", "found"),
    "seen": Private("observed", r"seen", "seen"),
    "kept": Private("cached, stored", r"kept", "kept"),
    "doubles": Private("float64", r"doubles", "doubles"),
    "balls, the truth": Private(
        "ball arithmetic, certified", r"balls?|enclosed|truth", "ball balls enclosed truth"
    ),
    "refuse": Private(
        "decline (keep)", r"refus\w+", "refuse refused refuses refusal refusals refusing"
    ),
    "rational": Private("scalar-generic (keep)", r"rational", "rational generic"),
    "prepare": Private("precompute", r"prepar\w+", "prepare prepared preparing"),
    "kind of scene": Private("scene class", r"kinds? of scenes?"),
    "hang together": Private(
        "are connected", r"hang(?:s|ing)?(?: together)?", "hanging hangs hang"
    ),
    "in words": Private("declarative, elements", r"in words|words", "words"),
    "structure": Private("structural variant", r"structures?", "structure structures"),
    "strata": Private("factors, pairwise coverage", r"strat(?:a|um)", "strata stratum"),
    "spread": Private("parallel map, sensitivity", r"spread", "spread"),
    "watch": Private("record", r"watch\w*", "watch watched watching"),
    "noise": Private("perturbation", r"noises?", "noise noises"),
    "in front": Private("leading axis", r"front", "front"),
    "rest, remainder": Private("drift, bias acceleration", r"rest|remainders?", "rest remainder"),
    "doors": Private("quick start", r"doors?", "doors"),
    "mend": Private("fix", r"mend\w*|unmended", "mend mended unmended"),
    "parties": Private("participants", r"parties", "parties"),
    "disturbed": Private("contended, noisy", r"disturb\w*", "disturbed"),
    "room": Private("workspace, capacity", r"rooms?", "room rooms"),
}
"""Private words of `language.md`, to be replaced by the field's, or kept where the row says so."""


def parts_of(identifier: str) -> set[str]:
    """Words of an identifier, in lower case."""
    return {x.lower() for x in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", identifier)}


def identifier_parts(sources: Iterable[str]) -> Counter[frozenset[str]]:
    """How often identifiers with each set of words stand in source texts."""
    return Counter(
        frozenset(parts_of(token.string))
        for source in sources
        for token in tokens_of(source)
        if token.type == tokenize.NAME and not keyword.iskeyword(token.string)
    )


def print_glossary(
    passages: dict[str, list[Passage]], identifiers: Counter[frozenset[str]], listed: bool
) -> None:
    """Print how often each private word stands in prose and in identifiers."""
    header = "".join(f"{name:>8}" for name in (*passages, "names"))
    print(f"{'private word':20}{'word of the field':28}{header}")
    for word, private in GLOSSARY.items():
        pattern = re.compile(rf"\b(?:{private.prose})\b".replace(" ", r"\s+"), re.IGNORECASE)
        found = {name: list(matches(pattern, texts)) for name, texts in passages.items()}
        parts = {*private.parts.split()}
        names = sum(number for words, number in identifiers.items() if words & parts)
        cells = "".join(f"{x:8}" for x in (*map(len, found.values()), names))
        print(f"{word:20}{private.field:28}{cells}")
        if listed:
            for place, line in (one for some in found.values() for one in some):
                print(f"    {place}: {line}")


def print_words(root: Path, listed: bool, glossary: bool) -> None:
    """Print how often clauses to avoid, or private words, stand in source and documentation."""
    sources = {x.relative_to(root): x.read_text(encoding="utf-8") for x in files_of(root)}
    passages = {
        "source": [x for file, text in sources.items() for x in source_passages(file, text)],
        "docs": list(documentation_passages(root)),
    }
    if glossary:
        print_glossary(passages, identifier_parts(sources.values()), listed)
    else:
        print_clauses(passages, listed)


def main() -> None:
    """Measure each checkout, and print a table for it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    roots: dict[str, Any] = {"nargs": "*", "type": Path, "default": [HERE], "metavar": "ROOT"}
    commands.add_parser("lines", help="lines by sort and room").add_argument("roots", **roots)
    walk = commands.add_parser("walk", help="files, rooms and depth of four call paths")
    walk.add_argument("roots", **roots)
    walk.add_argument("--only", choices=WALKS, action="append")
    walk.add_argument("--process", choices=WALKS, help=argparse.SUPPRESS)
    words = commands.add_parser("words", help="clauses to avoid and private words")
    words.add_argument("roots", **roots)
    words.add_argument("--list", action="store_true", help="print where each stands")
    words.add_argument("--glossary", action="store_true", help="count private words instead")
    options = parser.parse_args()
    if options.command == "walk" and options.process:
        print(json.dumps(measured_walks(options.process)))
        return
    measures: dict[str, Callable[[Path], None]] = {
        "lines": print_lines,
        "walk": lambda root: print_walks(root, options.only or WALKS),
        "words": lambda root: print_words(root, options.list, options.glossary),
    }
    for root in options.roots:
        print(f"== {root}")
        measures[options.command](root.resolve())


if __name__ == "__main__":
    main()
