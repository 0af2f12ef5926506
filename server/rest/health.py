"""REST for those who watch over the robot by machine: what must be so, and whether it is.

Read off the status, so that it says what the page says. Uses its siblings `cockpit` and `views`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field

from server.cockpit import PREFIX, Cockpit
from server.views import RobotStatus, Status

SILENT = 1.0  # s without a word from the robot
LOSSY = 20.0  # percent of frames
LATE = 100.0  # ms: a third of the driver's lease
SCARCE = 0.5  # GB left on the recording's disk: more than a day of driving


class Check(BaseModel):
    """One thing that must be so."""

    name: str = Field(examples=["link"])
    ok: bool = Field(examples=[True])
    detail: str = Field(examples=["heard 0.02 s ago"], description="what was found, for a person to read")


class Health(BaseModel):
    """Whether everything is as it must be."""

    ok: bool = Field(examples=[True])
    checks: list[Check]


def health_routes(cockpit: Cockpit) -> APIRouter:
    """One route for load balancers, supervisors and people in a hurry."""
    router = APIRouter(prefix=PREFIX)

    @router.get("/health", tags=["watching"], responses={503: {"model": Health, "description": "Some check failed"}})
    async def health(response: Response) -> Health:
        """200 while robot and laser are heard, the filter runs and there is room to record; 503 where one is not so."""
        checks = checks_of(cockpit.status())
        found = Health(ok=all(check.ok for check in checks), checks=checks)
        response.status_code = 200 if found.ok else 503
        return found

    return router


def checks_of(status: Status) -> list[Check]:
    """What must be so, of a status."""
    link, robot, worker = status.link, status.robot, status.filter
    silence = link.silence_s
    is_heard = silence is not None and silence <= SILENT
    connection = "connected" if link.connected else "not connected"
    error = "" if link.connected and any(link.side_lines.values()) else link.error  # that is told apart
    heard = "never heard" if silence is None else f"heard {silence:.2f} s ago"
    return [
        Check(name="link", ok=link.connected, detail=error or connection),
        *(Check(name=name, ok=not wrong, detail=wrong or "well") for name, wrong in link.side_lines.items()),
        Check(name="robot", ok=is_heard, detail=heard),
        Check(name="radio", ok=link.lost_percent < LOSSY, detail=f"{link.lost_percent:.1f} % of frames lost"),
        state_check(robot),
        Check(name="filter", ok=worker.state != "failed", detail=worker.reason or worker.state),
        Check(name="loop", ok=status.loop.late_p99_ms < LATE, detail=f"p99 {status.loop.late_p99_ms:.1f} ms late"),
        recording_check(status.recording),
    ]


def state_check(robot: RobotStatus) -> Check:
    """Whether the board that drives can: `balance` of a robot that tilts, and `motors` of one that does not."""
    told = robot.state or "not told yet"
    if robot.tilt_rad is not None:
        return Check(name="balance", ok=robot.state != "fallen", detail=told)
    reason = f" ({robot.stop_reason})" if robot.stop_reason else ""
    return Check(name="motors", ok=robot.state != "fault", detail=told + reason)


def recording_check(recording: str | None) -> Check:
    """Whether there is room for what is recorded, if anything is."""
    if recording is None:
        return Check(name="recording", ok=True, detail="off")
    try:
        free = shutil.disk_usage(Path(recording).parent).free / 1e9
    except OSError as error:
        return Check(name="recording", ok=False, detail=f"{recording}: {error.strerror}")
    return Check(name="recording", ok=free > SCARCE, detail=f"{recording}, {free:.1f} GB free")
