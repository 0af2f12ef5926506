"""The documents' check: it passes here, and it finds what it is meant to find."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def check() -> ModuleType:
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        spec = importlib.util.spec_from_file_location("docs_check", ROOT / "docs" / "check.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(ROOT / "docs"))
    return module


def test_the_documents_tell_the_truth(check):
    assert check.problems() == []


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[a](missing.md)\n", "a.md:1: missing.md is not there"),
        ("# Title\n[a](#elsewhere)\n", "a.md:2: #elsewhere has no such heading"),
        ("```\ncrunch dance\n```\n", "a.md:2: crunch has no command dance"),
        ("```sh\n$ crunch replay a.log \\\n    --oot b\n```\n", "a.md:2: crunch replay has no flag --oot"),
        ("Say `crunch score map --thruth a.tum`.\n", "a.md:1: crunch score has no flag --thruth"),
        ("Say `make coffee`.\n", "a.md:1: make has no target coffee"),
        ("| a | b |\n|---|---|\n| 1 |\n", "a.md:3: 1 cells under 2 headings"),
        ("| a |\n|---|\n| `1 | 2` |\n| `1 \\| 2` |\n", "a.md:3: 2 cells under 1 headings"),
    ],
)
def test_what_is_not_there_is_found(check, tmp_path, monkeypatch, text, told):
    (tmp_path / "Makefile").write_text((ROOT / "Makefile").read_text())
    monkeypatch.setattr(check, "ROOT", tmp_path)
    path = tmp_path / "a.md"
    path.write_text(text)
    assert [*check.broken_links(path), *check.ragged_rows(path), *check.wrong_commands(path)] == [told]


def test_what_is_there_is_not_complained_about(check, tmp_path, monkeypatch):
    (tmp_path / "Makefile").write_text((ROOT / "Makefile").read_text())
    monkeypatch.setattr(check, "ROOT", tmp_path)
    path = tmp_path / "a.md"
    path.write_text(
        "# A title, here\n[a](#a-title-here) [b](a.md) [c](https://example.org/x) `crunch COMMAND --help`\n"
        "```\nmake test  # all of it\ncrunch simulate --world demo --out a.rlog\ncrunch demo --no-browser\n```\n"
        "```text\ncrunch: error: anything\n```\n"
    )
    assert [*check.broken_links(path), *check.wrong_commands(path)] == []


def test_config_toml_is_as_written_by_its_maker():
    made = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "make_config.py")], check=True, capture_output=True, text=True
    )
    assert made.stdout == (ROOT / "config.toml").read_text(), "run `make config`"
