"""What a viewer may say: the words of the live stream and of the commands of REST, one class each.

Unknown keys, infinities and text for numbers are refused. Knows no rule of who may say what: that is `control`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter


class Word(BaseModel):
    """What every word has in common."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class DriveWord(Word):
    """Speed (m/s) and turn rate (rad/s), repeated while the stick is held; `seen` is the newest frame time shown.

    With `shared` the robot bends the direction away from obstacles, and slows down in front of them.
    """

    type: Literal["drive"]
    speed: float
    turn: float
    seen: float
    shared: bool = Field(default=False)


class GoalWord(Word):
    """Drive to (x, y) in the world as long as `hold` follows: by a way planned on the map, or straight on by sight.

    `id` is the viewer's own number of the goal: what becomes of it is told with it.
    """

    type: Literal["goal"]
    id: int = Field(default=0, ge=0, le=0xFFFFFFFF)
    x: float = Field(ge=-1e4, le=1e4)
    y: float = Field(ge=-1e4, le=1e4)
    speed: float = Field(default=0.3, gt=0.0, le=1.0)
    seen: float
    plan: bool = Field(default=True)


class HoldWord(Word):
    """The driver still watches while the robot drives to its goal."""

    type: Literal["hold"]
    id: int = Field(default=0, ge=0, le=0xFFFFFFFF)
    seen: float


class GiveWord(Word):
    """The driver hands the lease to the viewer who asks for it."""

    type: Literal["give"]
    to: str = Field(max_length=100)


class ArmWord(Word):
    """Let the drive board arm, or disarm it."""

    type: Literal["arm"]
    armed: bool


class AutopilotWord(Word):
    """Switch the virtual robot's own driver on or off."""

    type: Literal["autopilot"]
    on: bool


class PlainWord(Word):
    """stop: stand still; resume: end a stop; ask, keep and release: the lease; cancel: forget the goal."""

    type: Literal["stop", "resume", "ask", "keep", "release", "cancel"]


class AckWord(Word):
    """The newest frame that was shown."""

    type: Literal["ack"]
    seq: int = Field(ge=0, le=0xFFFFFFFF)


class PingWord(Word):
    """Answered at once with the same `sent`, to measure the way there and back."""

    type: Literal["ping"]
    sent: float


CommandWord = DriveWord | GoalWord | HoldWord | GiveWord | ArmWord | AutopilotWord | PlainWord
AnyWord = Annotated[CommandWord | AckWord | PingWord, Field(discriminator="type")]
WORDS: TypeAdapter[CommandWord | AckWord | PingWord] = TypeAdapter(AnyWord)
