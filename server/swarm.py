"""The command `crunch merge`; it imports what it needs when it runs. Uses its sibling `terminal`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from server.terminal import Assignments, ConfigFile, Seed, progress_bar


def merge(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Recordings of bumper carts in one area.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    seed: Seed = 0,
    config: ConfigFile = None,
    assignments: Assignments = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")] = False,
) -> None:
    """Make one map of several bumper carts' logs, none of which knew where it began.

    \b
        crunch merge monday.rlog tuesday.rlog --out room

    Each run of each log is a cart. OUT then holds map.png, map.pgm with map.yaml, map.json, the path of each cart in
    the common frame (NAME.tum), and merge.json, which tells who is left out and why (docs/bumper-cart.md).
    """
    from server.cart_merging import MergeOptions, merge_logs

    with progress_bar("merge", len(logs), quiet) as progress:
        summary, warnings = merge_logs(logs, out, MergeOptions(seed, config, assignments or ()), progress)
    for warning in warnings:
        typer.echo(f"crunch: warning: {warning}", err=True)
    if not quiet:
        typer.echo(f"{out}: {summary}")
