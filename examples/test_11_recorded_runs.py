"""Recorded runs: the regression suite of somebody who only has logs.

`drives/` holds two vehicles that face each other at an all-way stop, once driven well and once by somebody who rolls over the
line. They were kept by `rvads.files.save_run`; other logs are read likewise. Nothing drives here: each run is judged by every
rule of the road that is about its junction. The mark makes what is known to be wrong a strict xfail; without it the failure comes
with a replay.

    pytest test_11_recorded_runs.py -k stops          # one file
"""

import pytest_rvads as rvads


@rvads.known("rolls", recording="rolls", rule="full_stop", reason="the driver rolled over the line")
@rvads.recorded("drives/*.npz", rules="road")
def test_drives(monitor, rule):
    monitor.check(rule)


@rvads.recorded("drives")
def test_nobody_brakes_hard(rvads_recorded):
    for vehicle in rvads.kpis(rvads_recorded).vehicles:
        assert (vehicle.deceleration or 0.0) < 6.0
