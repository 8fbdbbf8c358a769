"""Sphinx configuration. Tables of formulations and claims are written from the registries, tables
of operations from the study, those of renamed names and of references from their files, the page of
commands from the command line."""

from __future__ import annotations

import re
import sys
import tomllib
from collections import Counter
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ConfigError

import eomcheck
from eomcheck import FORMULATIONS, Formulation, deprecated
from eomcheck.engines import LIBRARIES, READERS
from eomcheck.engines.tree_engine import library_key
from eomcheck.evaluation.conformance import QUANTITIES
from eomcheck.lab.deviations import READING, Deviation, Observation, read_deviations
from eomcheck.lab.references import reference_table
from eomcheck.lab.report.registries import in_paper, parameter_table, registry_table, yes
from eomcheck.lab.show.table import escaped as cell
from eomcheck.lab.show.table import markdown_table as table
from eomcheck.lab.show.table import table_of_markdown
from eomcheck.lab.studies import BENCHMARKS, STUDIES, study_of
from eomcheck.motion.reference_solution import load_reference
from eomcheck.scenes import SCENES

DOCS = Path(__file__).parent
GENERATED = DOCS / "_generated"
DEVIATIONS = DOCS / "conformance" / "deviations.toml"
sys.path.insert(0, str(DOCS))  # for commands.py, formulas.py, notebook_pages.py and pages.py

from commands import command_reference  # noqa: E402
from notebook_pages import notebook_pages  # noqa: E402

project = "eomcheck"
author = "The eomcheck developers"
project_copyright = "The eomcheck developers"
version = release = eomcheck.__version__

extensions = [
    "formulas",
    "myst_parser",
    "pages",
    "sphinx.ext.autodoc",
    "sphinx.ext.doctest",
    "sphinx.ext.githubpages",  # folders that begin with _ are served too
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build", "_generated", "figures/*.md", "paper-joss"]
default_role = "code"

myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_numpy_docstring = False
napoleon_use_ivar = True

doctest_test_doctest_blocks = ""
doctest_path = [str(DOCS / "guides"), str(DOCS / "development")]

html_math_renderer = "mathml"
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_title = f"eomcheck {release}"


# ---- Tables from the registries ------------------------------------------------------------------


def formulations_table() -> str:
    """Return the paper's Table I with what is different here, and below it what is not there."""
    sheet = registry_table("formulations").without("limits")
    order = sheet.columns.index("order")
    rows = []
    for row in sheet.rows:
        cells = [f"[{cell(row[0])}](/theory/{row[0]}.md)", *map(cell, row[1:])]
        cells[order] = f"${row[order]}$"
        rows.append(cells)
    return table(sheet.columns, rows)


def page_of(study: str) -> str:
    """Return the link to the page of a study, if it has one."""
    pages = (DOCS / folder / f"{study}.md" for folder in ("evidence", "development"))
    return next((f"[](/{x.relative_to(DOCS)})" for x in pages if x.is_file()), "")


def studies_table() -> str:
    """Return what is studied, by which command, and where its page is."""
    rows = [
        (f"`{command}`", what, page_of(key))
        for key, what in STUDIES.items()
        for command in [f"eomcheck {'bench' if key in BENCHMARKS else 'study'} {key}"]
    ]
    return table(("command", "what it does", "page"), rows)


USES = {
    "terms": "Lagrange's terms $M$, $F$, $a$, gamma",
    "speeds": "$M$, $F$ and the generalized speeds: $W$, rest",
    "bodies": "the bodies' partial velocities, masses, inertias and forces",
    "chain": "the chain's masses and forces along the quasi-velocities, and its joints",
}


def facts(f: Formulation) -> str:
    """Return what the registry says about one formulation, for the top of its theory page."""
    snake = [f.unknowns(links + 2, links, 2 * links) for links in (1, 2)]
    return table(
        (f"key `{f.key}`", f"Eqs. {cell(f.equations)}" if f.in_paper else "not in the paper"),
        [
            ("reads", USES[f.uses]),
            ("equations in the final system", f"${f.order_text}$"),
            ("the same for the snake", f"{snake[0]} at $N = 1$, {snake[1]} at $N = 2$"),
            ("constraints enter at", f"{f.level} level"),
            ("multipliers", f"{yes(f.multipliers)}; paper: {in_paper(f)}"),
        ],
    )


CALLED = {kind.__module__: kind for kind in reversed((*READERS.values(), *LIBRARIES.values()))}
"""File of an adapter -> its class that offers most of the quantities, and is the first of them."""


def library_calls() -> str:
    """Return the call of each library for each quantity, from the docstrings of the adapters."""
    sections = []
    for kind in reversed(CALLED.values()):
        rows = []
        for name in QUANTITIES:
            if kind.offers(name):
                first = str(getattr(kind, name).__doc__).strip().splitlines()[0]
                rows.append((f"`{name}`", cell(first.removeprefix("Return ").removesuffix("."))))
        key = library_key(kind)
        sections.append(f"### {key}\n\n{table(('quantity', 'from'), rows)}")
    return "\n\n".join(sections)


UNKNOWN = "not understood"
"""Beginning of the reason of a deviation that is not known."""


def figure_rows(name: str) -> list[list[str]]:
    """Return the rows of a table that a study wrote into `docs/figures`, without its heading."""
    text = (DOCS / "figures" / f"{name}.md").read_text(encoding="utf-8")
    return [[*map(str, row)] for row in table_of_markdown(name, text).rows]


def conformance_states() -> str:
    """Return the sentence with the numbers of states and pairs of the tables of conformance."""
    rows = figure_rows("conformance-libraries")
    robots = len(figure_rows("conformance-by-robot"))
    pairs, states = (sum(int(row[i]) for row in rows) for i in (3, 4))
    of = f"one of {len(rows)} libraries and one of {robots} robots and scenes"
    return f"The tables here are of {states} states, in {pairs} pairs of {of}."


def conformance_pages() -> str:
    """Return a section for each library: what it was asked, where it differs and why."""
    known = read_deviations(DEVIATIONS).deviations
    differences = figure_rows("conformance-differences")
    sections = []
    for key, version, quantities, robots, states, _ in figure_rows("conformance-libraries"):
        rows = []
        for library, quantity, names in differences:
            for deviation, mine in _by_reason(key, quantity, names.split("; "), known).items():
                if library == key:
                    rows.append((f"`{quantity}`", ", ".join(mine), *_about(deviation)))
        unread = [x for x in known if x.engine == key and READING in x.quantities]
        rows += [("not read", ", ".join(x.robots), *_about(x)) for x in unread]
        asked = f"{version}, asked for {quantities} quantities on {robots} robots and scenes"
        asked += f" at {states} states."
        columns = ("quantity", "differs on", "why", "seen since", "shown by", "issue")
        body = table(columns, rows) if rows else "It agrees in all of them."
        sections.append(f"### {key} on robots\n\n{asked}\n\n{body}")
    return "\n\n".join(sections)


def not_understood() -> str:
    """Return the list of deviations whose reason is not known: they begin with `UNKNOWN`."""
    every = read_deviations(DEVIATIONS).deviations
    known = [one for one in every if one.reason.startswith(UNKNOWN)]
    lines = (
        f"- {x.engine}, {', '.join(x.quantities)} on {', '.join(x.robots)}: {x.reason}"
        for x in known
    )
    return "\n".join(lines) or "Nothing: each deviation above has its reason."


def _by_reason(
    engine: str, quantity: str, robots: list[str], known: tuple[Deviation, ...]
) -> dict[Deviation | None, list[str]]:
    """Return the robots on which a quantity differs by the deviation that declares it."""
    found: dict[Deviation | None, list[str]] = {}
    for robot in robots:
        one = Observation(engine, quantity, robot, True)
        found.setdefault(next((x for x in known if x.covers(one)), None), []).append(robot)
    return found


def _about(deviation: Deviation | None) -> tuple[str, str, str, str]:
    """Return reason, version, script and issue of a deviation as cells."""
    if deviation is None:
        return "not declared", "", "", ""
    script = f"`{deviation.script}`" if deviation.script else ""
    issue = f"[issue]({deviation.issue})" if deviation.issue else ""
    return cell(deviation.reason), deviation.since, script, issue


COUNTED = "2..30"
"""Numbers of links whose counts the tables rest on; the command goes further."""


def operations_tables() -> dict[str, str]:
    """Return the tables of operations by the name of their files."""
    study = study_of("operations")
    names = {"formulation", "matrix"}
    return {
        f"{sheet.name}.md": table(
            tuple(sheet.columns),
            [
                tuple(
                    f"`{entry}`" if column in names else cell(entry)
                    for column, entry in zip(sheet.columns, row, strict=True)
                )
                for row in sheet.rows
            ],
        )
        for sheet in study.tables(study.run(links=COUNTED))
        if sheet.name in ("operations", "totals", "systems")
    }


def references_table() -> str:
    """Return the motions of the stored reference solutions, and how well each is known."""
    files = sorted((DOCS.parent / "validation" / "references").glob("*.json"))
    found = [load_reference(path) for path in files]
    motions = "\n".join(f"- `{r.name}`: {cell(r.description)}" for r in found)
    sheet = reference_table(found)
    names = {"Taylor": "first", "extrapolation": "second"}
    columns = [re.sub("|".join(names), lambda m: names[m[0]], c) for c in sheet.columns]
    return f"{motions}\n\n{sheet._replace(columns=columns).markdown()}"


def renamed_tables() -> dict[str, str]:
    """Return the tables of old and new names by the name of their files."""

    def owned(tables: dict[str, dict[str, str]]) -> list[tuple[str, ...]]:
        return [
            (f"`{owner}`", f"`{old}`", f"`{new}`")
            for owner, names in tables.items()
            for old, new in names.items()
        ]

    modules = [(f"`{old}`", f"`{new}`") for old, new in deprecated.MODULES.items()]
    values = [(f"`{old}`", f"`{new}`") for old, new in deprecated.VALUES.items()]
    return {
        "options": table(("command", "old", "new"), owned(deprecated.OPTIONS)),
        "fields": table(("class or function", "old", "new"), owned(deprecated.FIELDS)),
        "names": table(("module", "old", "new"), owned(deprecated.NAMES)),
        "modules": table(("old", "new"), modules),
        "values": table(("old", "new"), values),
        "record-keys": table(("study", "old", "new"), owned(deprecated.RECORD_KEYS)),
    }


def extras_table() -> str:
    """Return the table of extras: what pip installs for each."""
    project = tomllib.loads((DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    return table(
        ("extra", "installs"),
        [(f"`{name}`", ", ".join(f"`{x}`" for x in needed)) for name, needed in extras.items()],
    )


def bibtex() -> str:
    """Return the entries of a bibliography, for this version and for the paper."""
    (date,) = re.findall(r"^date-released: (\S+)$", CITATION.read_text("utf-8"), re.MULTILINE)
    return BIBTEX.replace("VERSION", eomcheck.__version__).replace("YEAR", date[:4])


CITATION = DOCS.parent / "CITATION.cff"
BIBTEX = """```bibtex
@software{eomcheck,
  author  = {{The eomcheck developers}},
  title   = {eomcheck: cross-validation of constrained multibody dynamics},
  version = {VERSION},
  year    = {YEAR},
  license = {MIT}
}

@article{talaeizadeh2020comparison,
  author  = {Talaeizadeh, Amin and Forootan, Mahmoodreza and Zabihi, Mehdi and
             Nejat Pishkenari, Hossein},
  title   = {Comparison of {Kane}'s and {Lagrange}'s Methods in Analysis of Constrained
             Dynamical Systems},
  journal = {Robotica},
  year    = {2020},
  doi     = {10.1017/S0263574719001899}
}
```"""


def paper_tally() -> str:
    """Return a sentence that counts the verdicts on the claims of the paper."""
    verdicts = Counter(row[3] for row in figure_rows("paper-claims"))
    plural = {
        "holds": "hold",
        "holds partly": "hold partly",
        "does not hold here": "do not hold here",
    }
    counts = ", ".join(f"{verdicts[one]} {many}" for one, many in plural.items())
    return f"Of {verdicts.total()} claims {counts}."


EQUIVALENCES = DOCS / "evidence" / "verified-equivalences.md"


def equivalences_table() -> str:
    """Return a line for each claim of the page of verified equivalences, linked to its section."""
    sections = EQUIVALENCES.read_text(encoding="utf-8").split("\n## ")[1:]
    rows = []
    for name, text in (section.split("\n", 1) for section in sections):
        if stated := re.search(r"^> \*\*(.*?)\*\*", text, re.MULTILINE):
            (levels,) = re.findall(r"^Evidence: (.*)\.$", text, re.MULTILINE)
            scenes = SCENES.keys() & set(re.findall(r"^\| ([a-z-]+) \|", text, re.MULTILINE))
            link = f"[{name}](/evidence/verified-equivalences.md#{name})"
            rows.append((link, stated[1], levels, str(len(scenes))))
    return table(("claim", "statement", "evidence", "scenes"), rows)


def equivalences_verdict() -> str:
    """Return the sentence of the page of verified equivalences that has the verdict."""
    text = EQUIVALENCES.read_text(encoding="utf-8")
    return next(
        line for line in text.splitlines() if re.match(r"(All )?\d+ (of|claims)|All ", line)
    )


def write(name: str, text: str) -> None:
    """Write a generated file, unless it holds that text already: Sphinx goes by its time."""
    path = GENERATED / name
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def parameters_file(key: str) -> str:
    """Return where the table of the parameters of a scene is written."""
    return f"parameters/{key}.md"


def write_tables(app: Sphinx) -> None:
    write("claims.md", registry_table("claims").markdown())
    write("formulations.md", formulations_table())
    write("studies.md", studies_table())
    write("references.md", references_table())
    write("commands.md", command_reference())
    write("extras.md", extras_table())
    write("bibtex.md", bibtex())
    write("paper-tally.md", paper_tally())
    write("equivalences-verdict.md", equivalences_verdict())
    write("equivalences.md", equivalences_table())
    write("library-calls.md", library_calls())
    write("conformance-pages.md", conformance_pages())
    write("conformance-states.md", conformance_states())
    write("not-understood.md", not_understood())
    for f in FORMULATIONS.values():
        write(f"facts/{f.key}.md", facts(f))
    for kind in SCENES.values():
        write(parameters_file(kind.key), parameter_table(kind).markdown())
    for name, text in operations_tables().items():
        write(name, text)
    for name, text in renamed_tables().items():
        write(f"renamed/{name}.md", text)
    for name, text in notebook_pages().items():
        write(f"notebooks/{name}.md", text)


# ---- What must be complete -----------------------------------------------------------------------


def check_complete(app: Sphinx) -> None:
    """Stop the build if a formulation has no theory page or a public name no entry in the API."""
    missing = [key for key in FORMULATIONS if not (DOCS / "theory" / f"{key}.md").is_file()]
    if missing:
        pages = ", ".join(f"docs/theory/{key}.md" for key in missing)
        raise ConfigError(f"formulations without a theory page: {pages} not found")
    for key in SCENES:
        page, include = f"scenes/{key}.md", f"{{include}} ../_generated/{parameters_file(key)}"
        if include not in (DOCS / page).read_text(encoding="utf-8"):
            raise ConfigError(f"docs/{page} has no ```{include}")
    pages = sorted((DOCS / "reference" / "api").glob("*.md"))
    api = "".join(page.read_text(encoding="utf-8") for page in pages)
    absent = [name for name in eomcheck.__all__ if f"eomcheck.{name}\n" not in api]
    if absent:
        raise ConfigError(f"docs/reference/api has no entry for: {', '.join(absent)}")


def escape_bars(app: Sphinx, what, name, obj, options, lines: list[str]) -> None:
    """Keep magnitudes such as |α| in docstrings from being read as substitutions."""
    lines[:] = [line.replace("|", "\\|") if "`" not in line else line for line in lines]


def setup(app: Sphinx) -> None:
    app.connect("builder-inited", check_complete)
    app.connect("builder-inited", write_tables)
    app.connect("autodoc-process-docstring", escape_bars)
