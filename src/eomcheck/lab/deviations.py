"""Known deviations of engines: a file of them, compared with the differences that are observed.

An `Observation` is the verdict on one quantity of one engine on one robot or scene. A `Deviation`
declares that an engine differs there, and why. A difference that is not declared is reported, and
so is a declared one that is no longer observed: a file of deviations is neither too short nor too
long.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from eomcheck.atomic_write import read_as
from eomcheck.claims import CLAIMS
from eomcheck.claims.finding import DECIDED, Finding
from eomcheck.claims.registry import ENGINE_TERMS
from eomcheck.engines.isolation import PINNED
from eomcheck.engines.tree_engine import without_suffix
from eomcheck.errors import InputError
from eomcheck.lab.show.table import say
from eomcheck.lab.store.record_file import group
from eomcheck.mechanics.scene import Scene

READING = "reading"
"""Quantity of a library that does not read the file of a robot."""

ALL = "*"
"""Any robot."""


def judged_quantities() -> tuple[str, ...]:
    """Return the quantities by which engines are judged: methods, and `READING`."""
    return (*dict.fromkeys(claim.asks for claim in CLAIMS.values() if claim.asks), READING)


class Observation(NamedTuple):
    """Verdict on one quantity of one engine on one robot or scene.

    Attributes:
        engine: key of the engine, maybe with a version.
        quantity: name of the method of engines, or `READING`.
        robot: name of the robot or scene.
        differs: whether it differs; None where nothing was decided.
        detail: the difference.
    """

    engine: str
    quantity: str
    robot: str
    differs: bool | None
    detail: str = ""


class Deviation(NamedTuple):
    """Known deviation of an engine.

    Attributes:
        engine: key of the engine.
        quantities: names of methods of engines, or `READING`.
        robots: names of robots or scenes; `ALL` for whichever.
        reason: why it differs.
        since: least version of the library in which it was observed.
        script: script that shows it without eomcheck.
        issue: address of an issue about it.
    """

    engine: str
    quantities: tuple[str, ...]
    robots: tuple[str, ...]
    reason: str
    since: str = ""
    script: str = ""
    issue: str = ""

    def covers(self, one: Observation) -> bool:
        """Return whether the deviation is about the engine, quantity and robot observed."""
        engine = self.engine in (one.engine, one.engine.partition(PINNED)[0])
        robot = ALL in self.robots or one.robot in self.robots
        return engine and robot and one.quantity in self.quantities


class KnownDeviations(NamedTuple):
    """Known deviations of engines, and the file that declares them."""

    file: Path
    deviations: tuple[Deviation, ...]

    def sentences(self, observations: Iterable[Observation]) -> Iterator[str]:
        """Yield a sentence on each difference that is not declared, and each one declared in vain.

        A deviation on named robots is declared in vain for each of them that was compared and does
        not differ; one on all robots if some were compared and none differs.
        """
        observations = list(observations)
        for one in observations:
            if one.differs and not any(known.covers(one) for known in self.deviations):
                where = f"{one.engine} differs in {one.quantity} on {one.robot}"
                why = f": {one.detail}" if one.detail else ""
                yield f"not declared in {self.file.name}: {where}{why}"
        for known in self.deviations:
            for quantity in known.quantities:
                mine = [x for x in observations if x.quantity == quantity and known.covers(x)]
                decided = [one for one in mine if one.differs is not None]
                differing = {one.robot for one in decided if one.differs}
                agreeing = list(dict.fromkeys(x.robot for x in decided if x.robot not in differing))
                if agreeing and not (ALL in known.robots and differing):
                    where = f"{known.engine} agrees in {quantity} on {', '.join(agreeing)}"
                    reason = known.reason
                    yield f"declared in {self.file.name} and not observed: {where} ({reason})"

    def differ(self, observations: Iterable[Observation]) -> bool:
        """Print the sentences about observations, and return whether there are any."""
        sentences = list(self.sentences(observations))
        for sentence in sentences:
            say(sentence)
        if not sentences:
            say(f"all differences are declared in {self.file.name}, and all declared ones observed")
        return bool(sentences)


# ---- Reading -------------------------------------------------------------------------------------

REQUIRED, OPTIONAL = ("engine", "quantity", "robots", "reason"), ("since", "script", "issue")
"""Keys of a deviation in a file."""


def read_deviations(path: Path) -> KnownDeviations:
    """Return the known deviations that a TOML file declares, each a table `[[deviation]]`.

    Raises:
        InputError: it cannot be read, is not TOML, or an entry has a key that is unknown, missing
            or of another type, or a quantity that is none.
    """
    name = repr(str(path))
    contents = read_as(path, "TOML", tomllib.loads)
    entries = contents.pop("deviation", [])
    if contents or not isinstance(entries, list):
        found = next(iter(contents), "deviation")
        raise InputError(f"{name} has {found!r}, expected tables [[deviation]] alone")
    deviations = (_deviation(f"{name}, deviation {k}", one) for k, one in enumerate(entries, 1))
    return KnownDeviations(path, tuple(deviations))


def _deviation(where: str, entry: Any) -> Deviation:
    """Return the deviation of one entry."""
    if not isinstance(entry, Mapping):
        raise InputError(f"{where} is {entry!r}, expected a table")
    for key in REQUIRED:
        if key not in entry:
            raise InputError(f"{where} has no {key!r}, expected {', '.join(REQUIRED)}")
    for key, value in entry.items():
        if key not in (*REQUIRED, *OPTIONAL):
            known = ", ".join((*REQUIRED, *OPTIONAL))
            raise InputError(f"{where} has {key!r}, expected one of {known}")
        many = key in ("quantity", "robots")
        texts = value if many and isinstance(value, list) else [value]
        if not texts or not all(isinstance(text, str) and text for text in texts):
            wanted = "a text or a list of texts" if many else "a text"
            raise InputError(f"{where}: {key} = {value!r}, expected {wanted}")
    quantities, robots = _texts(entry["quantity"]), _texts(entry["robots"])
    for one in quantities:
        if one not in judged_quantities():
            known = ", ".join(judged_quantities())
            raise InputError(f"{where}: quantity = {one!r}, expected one of {known}")
    more = {key: entry[key] for key in OPTIONAL if key in entry}
    return Deviation(entry["engine"], quantities, robots, entry["reason"], **more)


def _texts(value: str | list[str]) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else tuple(value)


# ---- Comparing -----------------------------------------------------------------------------------


def observations_of(
    findings: Iterable[tuple[str, Mapping[str, Any]]],
) -> Iterator[Observation]:
    """Yield an observation for each robot, engine and quantity of findings, the worst one of it.

    Args:
        findings: name of the robot or scene, and the finding as plain data (`Finding.as_dict`).
    """
    about = (
        (engine_in(one["subject"]), CLAIMS[one["claim"]].asks, robot, one)
        for robot, one in findings
        if names_engine(one["claim"], one["subject"])
    )
    for key, mine in group(about, lambda one: one[:3]).items():
        verdicts = [one["verdict"] for *_, one in mine]
        details = [one["detail"] for *_, one in mine if one["verdict"] == "failed"]
        decided = any(verdict in DECIDED for verdict in verdicts)
        engine, quantity, robot = key
        differs = bool(details) if decided else None
        yield Observation(engine, quantity, robot, differs, next(iter(details), ""))


def differs_by(verdict: str) -> bool | None:
    """Return whether a verdict is that of a difference; None where it decides nothing."""
    return verdict == "failed" if verdict in DECIDED else None


def names_engine(claim: str, subject: str) -> bool:
    """Return whether the subject of a finding on a claim is an engine, not a term of the scene."""
    asks = CLAIMS[claim].asks if claim in CLAIMS else ""
    return bool(asks) and subject != ENGINE_TERMS.get(asks)


def engine_in(subject: str) -> str:
    """Return the key of the engine that the subject of a finding names.

    >>> engine_in("gw ~ pinocchio_file"), engine_in("mujoco, hand ~ 2")
    ('pinocchio', 'mujoco')
    """
    key = subject.partition(", ")[0].rpartition(" ~ ")[2]
    library, pinned, version = key.partition(PINNED)
    return without_suffix(library) + pinned + version


def robot_of(scene: Scene | type[Scene]) -> str:
    """Return the name of a robot or scene in observations: its key, or that of its file.

    It is the name of the file without its ending; of a robot that floats "arm, free".
    """
    source = getattr(scene, "source", None)
    if source is None or not source.file:
        return scene.key
    return Path(source.file).stem + (", free" if source.floating else "")


def run_observations(findings: Iterable[Finding]) -> Iterator[Observation]:
    """Yield the observations of a run of `validate`."""
    return observations_of((robot_of(x.scene), x.as_dict(whole=False)) for x in findings if x.state)
