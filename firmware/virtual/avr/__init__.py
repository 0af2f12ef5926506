"""The two boards' real ATmega32 programs under simavr, in closed loop with the virtual robot's body and sensors."""

from firmware.virtual.avr.robot import AvrCrunch

__all__ = ["AvrCrunch"]
