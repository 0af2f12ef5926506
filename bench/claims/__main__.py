"""The thesis's own claims, measured, one table after the other, with pictures.

    python -m bench.claims [blur crossing points search resampling] [--seeds 20] [--docs]

`--docs` puts the tables into docs/claims.md and the pictures beside it. Drives are simulated and fused by the first
run, which takes some minutes longer, and kept in `build/bench`.
"""

from __future__ import annotations

import argparse
import time

from bench.claims import CLAIMS
from bench.claims.findings import Effort, markdown, renewed
from bench.claims.plots import save
from bench.recordings import CACHE, ROOT

PAGE = ROOT / "docs" / "claims.md"


def main() -> None:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("claims", nargs="*", metavar="CLAIM", help=f"of {', '.join(CLAIMS)}")
    parser.add_argument("--seeds", type=int, default=Effort().seeds)
    parser.add_argument("--docs", action="store_true", help="renew docs/claims.md and its pictures")
    wanted = parser.parse_args()
    if unknown := set(wanted.claims) - set(CLAIMS):
        parser.error(f"no such claim: {', '.join(sorted(unknown))}; there are {', '.join(CLAIMS)}")
    folder = PAGE.parent / "images" if wanted.docs else CACHE
    folder.mkdir(parents=True, exist_ok=True)
    for name in wanted.claims or CLAIMS:
        measure, draw = CLAIMS[name]
        started = time.perf_counter()
        findings = measure(Effort(seeds=wanted.seeds))
        for title, rows in findings.tables.items():
            print(f"\n{title}\n\n{markdown(rows)}", flush=True)
        save(draw, findings, folder / f"claims-{name}.png")
        print(f"\n{folder / f'claims-{name}.png'}, {time.perf_counter() - started:.0f} s", flush=True)
        if wanted.docs:
            PAGE.write_text(renewed(PAGE.read_text(), findings.tables))


if __name__ == "__main__":
    main()
