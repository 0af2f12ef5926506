"""A host of a bumper cart, for tests: commands it by the server's own encoder, and keeps what its board said."""

from __future__ import annotations

from typing import TypeVar

from firmware.virtual.bumper_cart import VirtualCart
from server.channels import CART, Calibration, decode, encode_command
from server.commands import Command
from server.link import Decoder, Frame, encode
from server.messages import Cart, CartStage, Status
from slam.cart_odometry import Stage

Told = TypeVar("Told", Cart, CartStage, Status)


class CartHost:
    """Hears a virtual cart, whatever its board is made of, and commands it."""

    def __init__(self, cart: VirtualCart, ms=200):
        self.cart = cart
        self.decoder = Decoder()
        self.heard: list[Frame] = []
        self.sequence = 0  # of the next command
        self.wait(ms)

    def wait(self, ms):
        self.heard += self.decoder.feed(self.cart.advance(ms * 1e-3))

    def frame(self, command: Command, age_ms=0) -> Frame:
        self.sequence = (self.sequence + 1) % 256
        return encode_command(command, self.sequence, (self.heard[-1].time_ms - age_ms) % 65536)

    def send(self, command: Command, age_ms=0):
        self.cart.write(encode(self.frame(command, age_ms)))

    def told(self, kind: type[Told]) -> list[Told]:
        """All messages of one kind, at the board's own times (s)."""
        messages = [decode(frame, frame.time_ms * 1e-3, Calibration()) for frame in self.heard]
        assert {frame.source for frame in self.heard} == {CART}
        return [message for several in messages for message in several if isinstance(message, kind)]

    @property
    def now(self) -> Cart:
        return self.told(Cart)[-1]

    def stages(self, is_kept=False) -> list[Stage]:
        return [told.stage for told in self.told(CartStage) if told.is_kept == is_kept]
