"""If this fails, a lease outlives the sleep of the machine that holds it: what others count on is that its time is over."""

from __future__ import annotations

import time

import pytest

from scenefold.world.real.clock import RealClock


@pytest.mark.skipif(not hasattr(time, "CLOCK_BOOTTIME"), reason="this system has no clock that is known to go on while the machine sleeps")
def test_time_goes_on_while_the_machine_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    slept_s = 3600.0
    awake = time.clock_gettime

    def after_a_sleep(clock: int) -> float:
        return awake(clock) + (slept_s if clock == time.CLOCK_BOOTTIME else 0.0)

    clock = RealClock()
    before = clock.now()
    monkeypatch.setattr(time, "clock_gettime", after_a_sleep)
    assert slept_s <= clock.now() - before < slept_s + 60.0
