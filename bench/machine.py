"""What the figures of a benchmark depend on beside the seeds: the machine and how busy it is, versions, the commit."""

from __future__ import annotations

import os
import platform
import subprocess
from pathlib import Path

from pydantic import BaseModel

from server.report import describe_machine

ROOT = Path(__file__).resolve().parent.parent
BUSY = 0.5  # load per core from which on speeds are not to be trusted


class Machine(BaseModel):
    """Processor, cores that may be used, memory (GB), system, versions, and the load when the benchmark began."""

    processor: str
    cores: int
    memory_gb: float
    system: str
    versions: dict[str, str]
    load: float  # processes that wanted to run, over the last minute

    @property
    def is_busy(self) -> bool:
        """Whether other work took so much that speeds are too low."""
        return self.load > BUSY * self.cores

    def __str__(self) -> str:
        versions = ", ".join(f"{name} {text}" for name, text in self.versions.items())
        busy = "; BUSY, speeds are too low" if self.is_busy else ""
        return (
            f"{self.processor}, {self.cores} cores, {self.memory_gb:.0f} GB, {self.system}; {versions}; "
            f"load {self.load:.1f} before it began{busy}"
        )


def machine() -> Machine:
    """This one, now."""
    versions = describe_machine()
    return Machine(
        processor=processor(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        memory_gb=round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1),
        system=versions.pop("platform"),
        versions=versions,
        load=os.getloadavg()[0],
    )


def processor() -> str:
    """The processor's name, as far as the system tells."""
    file = Path("/proc/cpuinfo")
    names = (
        [line.partition(":")[2].strip() for line in file.read_text().splitlines() if line.startswith("model name")]
        if file.exists()
        else []
    )
    return names[0] if names else platform.processor() or platform.machine()


def commit() -> str:
    """The checkout's commit, and whether files differ from it."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(ROOT), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short=10", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
