"""Checks the documents: links lead somewhere, commands and flags exist, tables are whole, config.toml is current."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

from make_config import config_toml
from typer.main import get_command

from server.__main__ import app

ROOT = Path(__file__).resolve().parents[1]
SHELLS = ("", "sh", "bash", "console", "shell")


def documents() -> list[Path]:
    """Every document of the project."""
    return [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]


def blocks_of(text: str) -> Iterator[tuple[int, str, str]]:
    """Line number, language and text of each code block."""
    for block in re.finditer(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        yield text.count("\n", 0, block.start()) + 2, block[1], block[2]


def without_blocks(text: str) -> str:
    """The text with its code blocks blanked out, line by line."""
    return re.sub(r"^```.*?^```", lambda block: "\n" * block[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL)


def without_code(text: str) -> str:
    """The text with all its code blanked out."""
    return re.sub(r"`[^`\n]*`", "", without_blocks(text))


def anchors_of(path: Path) -> set[str]:
    """The anchors of a document's headings, as GitHub makes them."""
    titles = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def broken_links(path: Path) -> Iterator[str]:
    """Links within the project that lead nowhere."""
    for number, line in enumerate(without_code(path.read_text()).splitlines(), 1):
        for target in re.findall(r"\]\(([^)\s]+)\)", line):
            if re.match(r"[a-z]+:", target):
                continue
            name, _, anchor = target.partition("#")
            file = (path.parent / name).resolve() if name else path
            if not file.exists():
                yield f"{path.relative_to(ROOT)}:{number}: {target} is not there"
            elif anchor and file.suffix == ".md" and anchor not in anchors_of(file):
                yield f"{path.relative_to(ROOT)}:{number}: {target} has no such heading"


def ragged_rows(path: Path) -> Iterator[str]:
    """Rows of tables with more or fewer cells than their heading has."""
    width = 0
    text = without_blocks(path.read_text())
    for number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("|"):
            width = 0
            continue
        cells = len(re.findall(r"(?<!\\)\|", line)) - 1  # also within code, as GitHub counts them
        width = width or cells
        if cells != width:
            yield f"{path.relative_to(ROOT)}:{number}: {cells} cells under {width} headings"


def command_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of shell blocks, and pieces of code in the text, with their numbers; continued lines are joined."""
    text = path.read_text()
    for start, language, block in blocks_of(text):
        if language in SHELLS:
            joined = re.sub(r"\\\n\s*", " ", block)
            yield from ((start + offset, line) for offset, line in enumerate(joined.splitlines()))
    for number, line in enumerate(text.splitlines(), 1):
        yield from ((number, code) for code in re.findall(r"`(crunch [^`]+|make [^`]+)`", line))


def wrong_make(words: list[str]) -> str:
    """What is wrong with the words after `make`, or nothing; `-C` leads to another folder's Makefile."""
    folder = ROOT
    if words[:1] == ["-C"]:
        folder, words = ROOT / words[1], words[2:]
    targets = set(re.findall(r"^([a-z]+):", (folder / "Makefile").read_text(), re.MULTILINE))
    unknown = [word for word in words if "=" not in word and not word.startswith("-") and word not in targets]
    return f"make has no target {unknown[0]}" if unknown else ""


def wrong_commands(path: Path) -> Iterator[str]:
    """Commands, flags and make targets that do not exist."""
    for number, line in command_lines(path):
        words = shlex.split(line.removeprefix("$ "), comments=True)
        problem = ""
        if words[:1] == ["crunch"]:
            problem = wrong_crunch(words[1:])
        elif words[:1] == ["make"]:
            problem = wrong_make(words[1:])
        if problem:
            yield f"{path.relative_to(ROOT)}:{number}: {problem}"


def wrong_crunch(words: list[str]) -> str:
    """What is wrong with a command line, or nothing."""
    known = {"--help", "-h", "--debug"}
    commands = getattr(get_command(app), "commands")  # noqa: B009
    names = [word for word in words if not word.startswith("-")]
    name = next(iter(names), "")
    if name.isupper() or not name:  # a placeholder
        return ""
    if name not in commands:
        return f"crunch has no command {name}"
    command = commands[name]
    group = getattr(command, "commands", None)  # `crunch calibrate odometry`: a command in a group
    if group is not None and len(names) > 1:
        if names[1] not in group:
            return f"crunch {name} has no command {names[1]}"
        command = group[names[1]]
    for parameter in command.params:
        known |= {*parameter.opts, *parameter.secondary_opts}
    flags = [word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)]
    unknown = [flag for flag in flags if flag not in known]
    return f"crunch {name} has no flag {unknown[0]}" if unknown else ""


def problems() -> list[str]:
    """Everything that is wrong."""
    checks = (broken_links, ragged_rows, wrong_commands)
    found = [problem for path in documents() for check in checks for problem in check(path)]
    if (ROOT / "config.toml").read_text() != config_toml():
        found.append("config.toml: differs from the defaults in the code; run `make config`")
    return found


def main() -> int:
    """Print what is wrong; exit code."""
    found = problems()
    for problem in found:
        print(problem, file=sys.stderr)
    print(f"{len(documents())} documents, {len(found)} problems")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
