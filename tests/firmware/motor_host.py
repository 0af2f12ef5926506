"""A host of a motor board, for tests: sends commands by the server's own encoder, and keeps what the board said."""

from typing import Any, TypeVar

from server.channels import MOTOR, Calibration, decode, encode_command
from server.commands import Command
from server.link import Decoder, Frame, encode
from server.messages import Motors, Status

Told = TypeVar("Told", Motors, Status)


class Host:
    """Hears a motor board, the one compiled for this machine or the simulated one, and commands it."""

    def __init__(self, board: Any, ms=100):
        self.board = board
        self.decoder = Decoder()
        self.heard: list[Frame] = []
        self.sequence = 0  # of the next command
        self.wait(ms)

    def wait(self, ms):
        self.heard += self.decoder.feed(self.board.run(ms))

    def frame(self, command: Command, age_ms=0) -> Frame:
        """The command's frame, as if the board had been heard last so long before its newest frame."""
        self.sequence = (self.sequence + 1) % 256
        return encode_command(command, self.sequence, (self.heard[-1].time_ms - age_ms) % 65536)

    def send(self, command: Command, age_ms=0):
        self.board.receive(encode(self.frame(command, age_ms)))

    def traced(self, ms):
        """The motors' powers after each of the next milliseconds."""
        powers = []
        for _ in range(ms):
            self.wait(1)
            powers.append(self.board.powers)
        return powers

    def told(self, kind: type[Told]) -> list[Told]:
        """All messages of one kind, at the board's own times (s)."""
        messages = [decode(frame, frame.time_ms * 1e-3, Calibration()) for frame in self.heard]
        assert {frame.source for frame in self.heard} == {MOTOR}
        return [message for several in messages for message in several if isinstance(message, kind)]

    @property
    def motors(self) -> Motors:
        return self.told(Motors)[-1]

    @property
    def status(self) -> Status:
        return self.told(Status)[-1]
