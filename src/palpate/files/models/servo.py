"""Define the file of a servo that was calibrated, and its summary."""

from __future__ import annotations

from palpate.control.servo import Servo
from palpate.files.models.model import Lines, Model
from palpate.files.schema import Key, TableForm
from palpate.files.units import measured


def of_servo(servo: Servo) -> Lines:
    """Return (name, text) pairs on a servo: its times, and the data that its fit left out."""
    way = "in a straight line, within the period" if servo.ramp else "at once"
    kind = "critically damped, of second order" if servo.order == 2 else "of first order"
    left = servo.provenance.get("left_out")
    return [
        ("commands", f"every {1e3 * servo.period:.4g} ms, reached {way}"),
        ("delay", measured([1e3 * servo.delay], [1e3 * servo.known], "ms")),
        ("lag", f"{measured([1e3 * servo.lag], [1e3 * servo.known], 'ms')}, {kind}"),
        *([] if left is None else [("left out", left)]),
    ]


SERVO = Model(
    Servo,
    "a servo model",
    "How a robot follows commands.",
    "palpate calibrate servo",
    of_servo,
    {
        Servo: TableForm(
            {
                "period": Key("s, between two commands", required=True),
                "delay": Key("s, from a command until the robot begins to follow it", required=True),
                "ramp": Key("s, in which it goes from one command to the next", required=True),
                "lag": Key("s, of the joints behind a ramp", required=True),
                "known": Key("s, standard deviation of delay and lag", required=True),
                "order": Key("of the lag: 2, critically damped, or 1"),
                "provenance": Key(),
            }
        )
    },
)
