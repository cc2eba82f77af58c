"""What leads from one state of a contact loop to the next, and what is refused."""

import numpy as np
import pytest

from palpate.contact import Status
from palpate.control.supervisor import Limits, State, Supervisor
from palpate.errors import InputError


def held(limits: Limits | None = None) -> Supervisor:
    """One that holds at 1 s."""
    supervisor = Supervisor(limits or Limits(), 7.0)
    for k in range(40):
        supervisor.fresh(0.8 + 0.005 * k, Status.CONTACT, 7.0)
    supervisor.pressed(1.0)
    assert supervisor.state == State.HOLD
    return supervisor


def test_a_touch_leads_to_contact_and_the_wanted_force_to_hold() -> None:
    supervisor = Supervisor(Limits(), 7.0)
    supervisor.fresh(0.1, Status.NO_CONTACT, 0.0)
    supervisor.fresh(0.2, Status.CONTACT, 0.3)  # less than what counts as a touch
    assert (supervisor.state, supervisor.why) == (State.APPROACH, "nothing touched yet")
    supervisor.fresh(0.3, Status.CONTACT, 0.6)
    assert supervisor.state == State.APPROACH  # one reading is no evidence
    supervisor.fresh(0.305, Status.CONTACT, 0.6)
    assert supervisor.state == State.CONTACT


def test_a_contact_that_is_gone_is_lost_then_given_up() -> None:
    supervisor = held()
    for k in range(1, 60):
        supervisor.fresh(1.0 + 0.005 * k, Status.NO_CONTACT, 0.0)
    assert supervisor.state == State.LOST
    assert "no contact" in supervisor.why
    supervisor.fresh(4.0, Status.NO_CONTACT, 0.0)
    assert supervisor.state == State.STOPPED
    assert supervisor.retreating


@pytest.mark.parametrize(("again", "state"), [(1.3, State.FOLLOW), (2.0, State.CONTACT)])
def test_a_touch_that_comes_back_soon_is_followed_on(again: float, state: State) -> None:
    """Within half a second what was known of the surface still is; later it presses anew."""
    supervisor = held()
    supervisor.silent(1.2)
    assert supervisor.state == State.LOST
    supervisor.fresh(again, Status.CONTACT, 6.0)
    assert supervisor.state == state


def test_a_sensor_that_comes_back_before_any_touch_goes_on_approaching() -> None:
    supervisor = Supervisor(Limits(), 7.0)
    supervisor.silent(0.5)
    assert supervisor.state == State.LOST
    supervisor.fresh(0.6, Status.NO_CONTACT, 0.0)
    assert supervisor.state == State.APPROACH


@pytest.mark.parametrize(
    ("status", "force", "state", "said"),
    [
        (Status.CONTACT, 25.0, State.STOPPED, "25 N is more than the limit of 20 N"),
        (Status.SATURATED, 7.0, State.STOPPED, "saturated"),
        (Status.INVALID, 0.0, State.HOLD, "held"),
        (Status.AMBIGUOUS, 7.0, State.HOLD, "held"),
    ],
)
def test_what_a_reading_says_of_itself_counts(status: Status, force: float, state: State, said: str) -> None:
    supervisor = held()
    supervisor.fresh(1.005, status, force)
    assert supervisor.state == State.HOLD  # one reading is no evidence
    supervisor.fresh(1.010, status, force)
    assert supervisor.state == state
    assert said in supervisor.why


def test_what_stopped_stays_stopped_until_it_is_started() -> None:
    supervisor = held()
    supervisor.stop(1.1, "asked to")
    supervisor.fresh(1.2, Status.CONTACT, 7.0)
    supervisor.stop(1.3, "something else")
    assert (supervisor.state, supervisor.why, supervisor.retreating) == (State.STOPPED, "asked to", False)
    supervisor.start(2.0)
    assert supervisor.state == State.APPROACH


def test_limits_that_cannot_be_kept_are_refused() -> None:
    with pytest.raises(InputError, match=r"above the wanted force.*Leave"):
        Supervisor(Limits(force=7.0), 7.0)
    for wrong in ({"speed": 0.0}, {"tilt": np.nan}, {"lost": -1.0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            Limits(**wrong)
    with pytest.raises(InputError, match=r"limits: drift"):
        Limits(drift=(-1.0, 0.0))


def test_hold_ends_while_the_force_is_outside_the_band_and_comes_back_inside() -> None:
    """The promise: never `hold` after 0.2 s outside, whatever the noise; readings at 200 Hz."""
    supervisor, rng = held(), np.random.default_rng(3)
    outside = inside = held_inside = 0.0
    for k in range(4000):
        now, true = 1.0 + 0.005 * k, 7.0 + 2.0 * np.sin(0.005 * k)
        supervisor.fresh(now, Status.CONTACT, true + 0.04 * rng.standard_normal())
        supervisor.pressed(now)
        if abs(true - 7.0) > supervisor.within:
            outside += 0.005
            assert outside < 0.2 or supervisor.state == State.FOLLOW
            assert supervisor.state == State.HOLD or "the force is" in supervisor.why
        else:
            outside, inside = 0.0, inside + 1
            held_inside += supervisor.state == State.HOLD
    assert held_inside > 0.95 * inside


@pytest.mark.parametrize("within", [0.0, -1.0, np.nan])
def test_a_band_that_is_none_is_refused(within: float) -> None:
    with pytest.raises(InputError, match=r"within: within"):
        Supervisor(Limits(), 7.0, within)
