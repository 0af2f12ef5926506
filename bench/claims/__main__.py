"""Puts the tables that `crunch bench claims` printed and kept into docs/claims.md, and draws the pictures beside it.

    crunch bench claims
    python -m bench.claims [--results build/bench/claims.json]

Claims that the results do not have stay as they are, so that one alone can be renewed after `--only NAME`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.claims import CLAIMS
from bench.claims.findings import Findings, markdown, renewed
from bench.claims.plots import save
from bench.recordings import CACHE, ROOT
from bench.result import Result, Results

PAGE = ROOT / "docs" / "claims.md"


def texts_of(result: Result) -> dict[str, str]:
    """What stands in the page's places: every claim's tables, and what made them."""
    texts = {}
    for row in result.rows:
        [record] = row.records
        texts |= {name: markdown(table) for name, table in record["tables"].items()}
        texts[f"{row.name}-made"] = made_by(result, row.name)
    return texts


def made_by(result: Result, claim: str) -> str:
    """The command, when it was run, at which commit and on what."""
    made = f"{result.date[:10]}, commit {result.commit[:7]}, {result.machine.processor}"
    return f"*`crunch bench claims --only {claim} --seeds {result.seeds}`, {made}.*"


def main() -> None:
    """Renew the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, default=CACHE / "claims.json")
    result = Results.read(parser.parse_args().results).results["claims"]
    PAGE.write_text(renewed(PAGE.read_text(), texts_of(result)))
    for row in result.rows:
        findings, path = Findings(row.records[0]["tables"], row.records[0]["curves"]), picture_of(row.name)
        save(CLAIMS[row.name][1], findings, path)
        print(path)
    print(PAGE)


def picture_of(claim: str) -> Path:
    """Where a claim's picture lies."""
    return PAGE.parent / "images" / f"claims-{claim}.png"


if __name__ == "__main__":
    main()
