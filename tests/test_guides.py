"""What the guides show: the formulation that one adds is right, and a mistake in it is found."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

import eomcheck
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.scenes import Snake

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
SHIFTED = ROOT / "docs" / "development" / "shifted.py"


def shifted(path: Path) -> Formulation:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.SHIFTED


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("system(M, F - a.T", "system(M, F + a.T"),
        ("a.T, F - a.T @ gamma", "a.T, F + a.T @ gamma"),
        ("mobility[:, r] + gamma", "mobility[:, r] - gamma"),
        ("shifted = M + np", "shifted = M - np"),
    ],
)
@pytest.mark.sampled(2)
def test_a_mistake_in_an_added_formulation_is_found_and_named(tmp_path, monkeypatch, old, new):
    source = SHIFTED.read_text(encoding="utf-8")
    assert source.count(old) == 1
    path = tmp_path / f"shifted_{abs(hash(new))}.py"
    path.write_text(source.replace(old, new), encoding="utf-8")
    monkeypatch.setitem(FORMULATIONS, "shifted", shifted(path))
    scene = Snake.coil(3)
    q, _ = scene.initial_state()
    found = eomcheck.check_state(scene, q, eomcheck.velocity(scene, q, [1.0, 0.5]))
    proved = eomcheck.prove(Snake, 3, formulations=["au", "shifted"], seed=0)
    for findings in (found, proved):
        failed = [finding for finding in findings if finding.verdict == "failed"]
        assert failed
        assert all("shifted" in str(finding) for finding in failed)


def test_the_citation_is_that_of_this_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (version,) = re.findall(r"^version: (.*)$", text, re.MULTILINE)
    assert version == eomcheck.__version__


# ---- Conformance of your engine ------------------------------------------------------------------

CONFORMANCE = (DOCS / "guides" / "conformance-of-your-engine.md").read_text(encoding="utf-8")
WRONG_SIGN = "return self.coupling * np.sin", "return -self.coupling * np.sin"


def block_of(kind: str) -> str:
    """Return the only block of a language in the guide."""
    (block,) = re.findall(rf"^```{kind}\n(.*?)^```$", CONFORMANCE, re.S | re.M)
    return block


def test_the_deviations_that_the_guide_shows_are_those_of_its_file():
    assert block_of("toml") == (DOCS / "guides/ci/deviations.toml").read_text(encoding="utf-8")
    assert len(block_of("yaml").splitlines()) == 15


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("wrong", "declared", "codes", "said"),
    [
        (True, True, [0, 0], "all differences are declared in deviations.toml"),
        (False, True, [1, 0], "not observed: byhand agrees in bias on chain-pendulum"),
        (True, False, [1, 0], "not declared in deviations.toml: byhand differs in bias on chain"),
    ],
)
def test_the_workflow_of_the_guide_is_red_for_what_is_unknown_and_for_what_is_gone(
    wrong: bool, declared: bool, codes: list[int], said: str, tmp_path, monkeypatch
):
    source = (DOCS / "guides" / "ci" / "by_hand.py").read_text(encoding="utf-8")
    assert source.count(WRONG_SIGN[0]) == 1
    (tmp_path / "by_hand.py").write_text(source.replace(*WRONG_SIGN) if wrong else source)
    (tmp_path / "deviations.toml").write_text(block_of("toml") if declared else "")
    runs = re.findall(r"- run: eomcheck (.*)", block_of("yaml"))
    run = "from eomcheck.cli import main; main()"
    printed, ended = "", []
    for words in runs:
        words = words.replace("--examples 30", "--examples 3 --links 1..2").split()
        done = subprocess.run(
            [sys.executable, "-c", run, *words], capture_output=True, text=True, cwd=tmp_path
        )
        ended.append(done.returncode)
        printed += " ".join(done.stdout.split()) + done.stderr
    assert ended == codes, printed
    assert said in printed
    assert (tmp_path / "conformance.svg").read_text(encoding="utf-8").startswith("<svg")
