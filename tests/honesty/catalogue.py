"""The catalogue: what was tried in order to get a green that is not deserved, what an innocent driver does, and what is told.

Plain data, for the tests beside it and for a page of the documentation. Every entry is shown by one test, see
``test_catalogue.py``. Rules go by their names: `progress` is a rule, PASS FAIL OPEN UNAVOIDABLE PROVOKED UNSURE NA
ERROR NOT JUDGED NOT RUN are outcomes. What is not mentioned is PASS or NA.
"""

from dataclasses import dataclass

__all__ = ["CHEATS", "INNOCENTS", "UNWATCHED", "Entry"]


@dataclass(frozen=True, slots=True)
class Entry:
    """One way to cheat, or to be innocent."""

    name: str
    """Short, and the same in the test that shows it."""
    group: str
    tries: str
    """What the attempt does."""
    told: str
    """What the tool says of it."""


DRIVING = "driving"
CONFLICTS = "conflicts and crashes"
PEDESTRIANS = "pedestrians"
STACKS = "controllers that attack the tool"
TESTS = "tests"
SESSIONS = "sessions"
RECORDINGS = "recordings"
SEARCHES = "rules and searches"

CHEATS = (
    # Getting nowhere, and being in the way.
    Entry(
        "idle",
        DRIVING,
        "stands on the brake from the start",
        "`progress` FAIL after 10 s; all other rules NA, because they bound only traffic",
    ),
    Entry(
        "idle_in_a_short_run",
        DRIVING,
        "stands on the brake at the line, in a run too short for `progress` to fail",
        "NA: a vehicle that never moves keeps no rule by acting",
    ),
    Entry(
        "idle_together",
        DRIVING,
        "stands on the brake from the start, and so do all other vehicles, which are its copies",
        "NA: nobody moved",
    ),
    Entry(
        "creep_on_approach", DRIVING, "creeps towards the line at 0.11 m/s", "`progress` FAIL: below walking pace time is lost"
    ),
    Entry(
        "stop_short_of_the_line",
        DRIVING,
        "stops 3 m before the line for ever",
        "`progress` FAIL; `full_stop` NA, because the vehicle never got there",
    ),
    Entry(
        "stop_and_go",
        DRIVING,
        "rolls for a second after every 4 s, so that it never stands for 10 s",
        "`progress` FAIL: lost time adds up",
    ),
    Entry("idle_at_green", DRIVING, "waits at the line while the light is green", "`progress` FAIL"),
    Entry(
        "creep_inside",
        DRIVING,
        "stops at the sign, then creeps through the junction at 0.3 m/s",
        "`keep_clear` FAIL, `progress` FAIL",
    ),
    Entry(
        "twenty_short_stops_inside",
        DRIVING,
        "stops in the junction twenty times, for 2.9 s each",
        "`keep_clear` FAIL, `progress` FAIL: lost time adds up",
    ),
    Entry(
        "stop_inside", DRIVING, "stops in the middle of the junction", "`keep_clear` FAIL after 3 s, `progress` FAIL after 10 s"
    ),
    Entry(
        "stop_right_behind_the_junction",
        DRIVING,
        "stops on the exit road as soon as its rear has left the junction",
        "`progress` FAIL; `keep_clear` PASS",
    ),
    # Leaving the lane, the route, the limit.
    Entry(
        "circling",
        DRIVING,
        "drives in circles in the junction",
        "`on_route` FAIL, `keep_lane` FAIL; rules kept so far are OPEN, because this vehicle ended the run",
    ),
    Entry(
        "leave_the_route_inside",
        DRIVING,
        "turns off to the left where its route goes straight on",
        "`on_route` FAIL, `keep_lane` FAIL; rules kept so far are OPEN",
    ),
    Entry(
        "leave_the_route_before_the_line",
        DRIVING,
        "drives off the road to the right before it gets to the sign",
        "`on_route` FAIL, `keep_lane` FAIL; `progress` OPEN; `full_stop` NA",
    ),
    Entry(
        "red_then_off_the_route",
        DRIVING,
        "runs a red light straight on and turns off behind it, as if to turn right on red",
        "`red` FAIL all the same; `on_route` FAIL, `keep_lane` FAIL",
    ),
    Entry(
        "oncoming_lane",
        DRIVING,
        "drives into the oncoming lane, not quite as far as `on_route` allows",
        "`keep_lane` FAIL",
    ),
    Entry(
        "on_the_border_of_the_lane", DRIVING, "drives 1.5 m beside the middle of its lane, over the border", "`keep_lane` FAIL"
    ),
    Entry("a_little_too_fast", DRIVING, "drives 0.8 m/s over the limit, where 0.5 m/s are tolerated", "`speed_limit` FAIL"),
    # What looks like obeying signs and lights.
    Entry("roll_over_the_line", DRIVING, "slows down to 0.5 m/s and rolls over the line of the stop sign", "`full_stop` FAIL"),
    Entry("creep_over_the_line", DRIVING, "creeps over the line of the stop sign at 0.15 m/s", "`full_stop` FAIL"),
    Entry(
        "stop_six_metres_before_the_line",
        DRIVING,
        "stops 6 m before the sign and then drives through",
        "`full_stop` FAIL: this was no stop at the sign",
    ),
    Entry(
        "stop_beyond_the_line",
        DRIVING,
        "stops between the line and the junction, with a line 3 m before the junction",
        "`full_stop` FAIL",
    ),
    Entry("red_after_a_stop", DRIVING, "stops at the red light, waits, and goes straight on at red", "`red` FAIL"),
    Entry("speed_up_on_yellow", DRIVING, "speeds up on yellow, although it could have stopped, and enters on red", "`red` FAIL"),
    Entry(
        "stand_beyond_the_line_at_red",
        DRIVING,
        "stops for the red light, 1 m inside the junction",
        "`red` FAIL",
    ),
    Entry("right_on_red_without_a_stop", DRIVING, "turns right on red without stopping first", "`right_on_red` FAIL"),
    # Taking the way of others.
    Entry(
        "left_turn_that_makes_others_brake",
        CONFLICTS,
        "turns left so close in front of oncoming traffic that the oncoming vehicle has to brake hard",
        "`left_yields` FAIL",
    ),
    Entry(
        "left_turn_with_half_a_second_to_spare",
        CONFLICTS,
        "turns left and is gone half a second before the oncoming vehicle is there",
        "`left_yields` FAIL: less than a second is a near miss",
    ),
    Entry(
        "left_turn_into_a_crash",
        CONFLICTS,
        "turns left into an oncoming vehicle that has green as well",
        "`left_yields`, `no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "keep_left_and_turn_right_into_a_crash",
        CONFLICTS,
        "where traffic keeps left, turns right into an oncoming vehicle that has green as well",
        "`left_yields`, `no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "join_so_near_ahead_that_others_must_brake",
        CONFLICTS,
        "joins from a ramp so close ahead of a vehicle that this vehicle has to brake hard",
        "`merge` FAIL",
    ),
    Entry(
        "right_on_red_without_looking",
        CONFLICTS,
        "stops at the red light, turns right, and is hit by a vehicle that has green",
        "`right_on_red`, `no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "go_when_the_other_is_slow",
        CONFLICTS,
        "goes first at an all-way stop while the vehicle that came earlier hesitates",
        "`first_come` FAIL",
    ),
    Entry(
        "left_before_right",
        CONFLICTS,
        "goes first at an all-way stop although the vehicle on its right came at the same time",
        "`right_first` FAIL",
    ),
    Entry(
        "cross_without_looking",
        CONFLICTS,
        "stops at the sign and drives into a vehicle that is crossing already",
        "`no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "left_turn_without_looking_ahead",
        CONFLICTS,
        "stops at the sign and turns left into a vehicle that comes from straight ahead",
        "`no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "enter_together_and_be_half_to_blame",
        CONFLICTS,
        "turns left in the very step in which the oncoming vehicle sets off, too, and the two crash",
        "`no_conflict`, `no_collision` FAIL: half of the blame is enough",
    ),
    Entry(
        "roll_in_behind_another",
        CONFLICTS,
        "runs the sign right behind another vehicle, when nobody is in the way any more",
        "`full_stop` FAIL",
    ),
    # Leaving it to others to be blamed.
    Entry(
        "run_the_sign_and_be_hit_by_who_enters_last",
        CONFLICTS,
        "runs the sign slowly, so that a vehicle with the right of way enters later and hits it",
        "`full_stop`, `first_come`, `no_conflict`, `no_collision` FAIL: right of way counts, not the order of entry",
    ),
    Entry(
        "run_a_red_light_and_be_hit_by_who_enters_last",
        CONFLICTS,
        "runs a red light, and a vehicle with green enters later and hits it",
        "`red`, `no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "ram_who_ran_the_sign",
        CONFLICTS,
        "waits at the sign and drives into a vehicle that rolled through its sign and has been in the junction for 4 s",
        "`no_conflict`, `no_collision` FAIL: the subject could have stopped, and shares the blame",
    ),
    Entry(
        "ram_who_ran_the_red_light",
        CONFLICTS,
        "waits at green and drives into a vehicle that ran the red light and has been in the junction for 6 s",
        "`no_conflict`, `no_collision` FAIL: the subject could have stopped, and shares the blame",
    ),
    Entry(
        "crash_late",
        CONFLICTS,
        "waits at red for 20 s and then drives into a vehicle that stood in the junction all the time",
        "`no_conflict`, `no_collision` FAIL; rules broken by the standing vehicle are PROVOKED",
    ),
    Entry(
        "run_into_who_waits_on_the_exit_road",
        CONFLICTS,
        "drives into a vehicle that waits on its exit road",
        "`no_collision` FAIL",
    ),
    Entry(
        "head_on_in_the_oncoming_lane",
        CONFLICTS,
        "drives in the oncoming lane into a vehicle that enters later",
        "`keep_lane` FAIL, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "enter_without_room_to_leave",
        CONFLICTS,
        "enters although a vehicle on the exit road leaves no room, and stands in the junction",
        "`keep_clear` FAIL; rules broken by the standing vehicle are PROVOKED",
    ),
    # Waiting without a reason.
    Entry(
        "keep_others_waiting",
        CONFLICTS,
        "comes first to an all-way stop and stays, so that another vehicle has to wait",
        "`progress` FAIL, `first_come` OPEN",
    ),
    Entry(
        "end_the_run_at_red",
        CONFLICTS,
        "waits at red, as does another vehicle, until the run is over, before the light is green",
        "`red` OPEN, which fails: the run was too short",
    ),
    Entry(
        "block_each_other_inside",
        CONFLICTS,
        "two copies stop in the junction, each for the other copy",
        "`keep_clear`, `progress` FAIL by both",
    ),
    Entry(
        "wave_each_other_through_for_ever",
        CONFLICTS,
        "two copies that face each other at an all-way stop each let the other copy go first",
        "`progress` FAIL by both",
    ),
    Entry(
        "wait_for_who_waits_for_you",
        CONFLICTS,
        "waits at green for a left-turner, and the left-turner waits in the middle",
        "`progress` FAIL by the vehicle that had the right to go",
    ),
    Entry(
        "deadlock_of_four",
        CONFLICTS,
        "four copies at an all-way stop each wait for the copy on the right",
        "`progress` FAIL by all four, `right_first` OPEN",
    ),
    Entry(
        "run_down_who_crosses_a_crosswalk",
        PEDESTRIANS,
        "drives over a crosswalk without looking at pedestrians there",
        "`crosswalk`, `no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "turn_over_a_crosswalk_without_looking",
        PEDESTRIANS,
        "turns right at green into a pedestrian who crosses on WALK",
        "`crosswalk_turning`, `no_conflict`, `no_collision` FAIL, and the subject is to blame",
    ),
    Entry(
        "run_down_who_crosses_against_the_light",
        PEDESTRIANS,
        "drives on at green into a pedestrian who crosses against the pedestrian light, in plain sight",
        "`no_conflict`, `no_collision` FAIL: the subject could have stopped, and shares the blame",
    ),
    Entry(
        "hurry_past_a_parked_vehicle_that_hides_the_kerb",
        PEDESTRIANS,
        "hurries past a parked vehicle at 29 km/h, and hits a pedestrian who comes out from behind it",
        "`crosswalk`, `no_conflict`, `no_collision` FAIL: the subject was faster than 25 km/h",
    ),
    Entry(
        "stop_on_a_crosswalk",
        PEDESTRIANS,
        "stops with its body over a crosswalk for two seconds without a reason",
        "`crosswalk_clear` FAIL",
    ),
    Entry(
        "wait_for_ever_for_who_stands_at_the_kerb",
        PEDESTRIANS,
        "waits at a crosswalk for a pedestrian who stands at the kerb and never goes",
        "`progress` FAIL; `crosswalk` NA",
    ),
    Entry(
        "four_racers",
        CONFLICTS,
        "four copies race into an all-way stop in the same step",
        "`full_stop`, `right_first` FAIL by all four; one vehicle had to go first, not four, so nothing is UNAVOIDABLE",
    ),
    Entry(
        "four_racers_one_step_apart",
        CONFLICTS,
        "four copies race into an all-way stop, one after the other, a hundredth of a second apart",
        "`full_stop`, `right_first` FAIL: only the first copy had to break the circle",
    ),
    # Controllers that attack the tool.
    Entry(
        "raise_after_the_violation",
        STACKS,
        "runs the sign and then raises, to turn FAIL into ERROR",
        "`full_stop` FAIL; all other rules ERROR",
    ),
    Entry("nan_after_the_violation", STACKS, "runs the sign and then answers NaN", "`full_stop` FAIL; all other rules ERROR"),
    Entry("skip_inside", STACKS, "calls `pytest.skip` when asked for a command", "ERROR, not a skip"),
    Entry("xfail_inside", STACKS, "calls `pytest.xfail` when asked for a command", "ERROR, not an expected failure"),
    Entry("exit_inside", STACKS, "raises SystemExit when asked for a command", "ERROR; the other tests run"),
    Entry(
        "clear_the_junction",
        STACKS,
        "deletes the movements of the junction in its observation",
        "impossible; `full_stop` FAIL as before",
    ),
    Entry(
        "bend_the_itinerary",
        STACKS,
        "moves points of the itinerary in its observation",
        "this changes no verdict; `full_stop` FAIL as before",
    ),
    Entry(
        "shrink_the_vehicle",
        STACKS,
        "makes the vehicle in its observation so thin that it always fits into its lane",
        "this changes no verdict; `keep_lane` FAIL as before",
    ),
    Entry(
        "behave_in_seat_0_only",
        STACKS,
        "keeps the rules only under the name a0, as in most examples",
        "`full_stop` PASS in seat 0, FAIL in seat 1",
    ),
    Entry(
        "drive_otherwise_every_time",
        STACKS,
        "drives in another way when its run is repeated",
        "the test fails, and its record says that it is FLAKY",
    ),
    Entry(
        "break_the_diagnosis",
        STACKS,
        "raises when its failed run is simulated once more",
        "the test fails as before; no other verdict is lost",
    ),
    Entry(
        "exit_in_the_diagnosis",
        STACKS,
        "raises SystemExit when its failed run is simulated once more",
        "the test fails as before; no other verdict is lost",
    ),
    Entry(
        "hand_in_nonsense_for_the_report",
        STACKS,
        "gives nonsense as its computing times, to confuse the report",
        "FAIL, and the report is written",
    ),
    Entry("end_the_process", STACKS, "ends its process with exit status 0", "ERROR; under pytest-xdist the session goes on"),
    # Tests that pass over a violation, or judge something else.
    Entry("judge_elsewhere", TESTS, "takes a rule and never gives it to the monitor", "NOT JUDGED, which fails"),
    Entry("never_ask_the_monitor", TESTS, "takes the monitor and never calls it", "NOT JUDGED, which fails"),
    Entry("swallow_by_try", TESTS, "catches the violation and goes on", "FAIL at the end of the test"),
    Entry("swallow_by_raises", TESTS, "expects the violation with `pytest.raises`", "FAIL at the end of the test"),
    Entry("swallow_then_skip", TESTS, "catches the violation and skips", "FAIL, not a skip"),
    Entry("swallow_then_xfail", TESTS, "catches the violation and calls `pytest.xfail`", "FAIL, not an expected failure"),
    Entry(
        "swallow_then_forget",
        TESTS,
        "catches the violation, deletes the verdicts of the monitor and checks a harmless rule",
        "FAIL: a verdict can't be deleted",
    ),
    Entry("verdict_without_assertion", TESTS, "asks for the verdict and asserts nothing", "FAIL at the end of the test"),
    Entry("check_another_rule", TESTS, "checks p2 in the item about p1", "ERROR: this can't be the verdict of the item"),
    Entry(
        "judge_another_run", TESTS, "gives the monitor the run of another controller", "no PASS: the item is about its own run"
    ),
    Entry(
        "a_run_of_its_own",
        TESTS,
        "hides the fixture `run` behind a fixture with another run",
        "no PASS: the item is about its own run",
    ),
    Entry(
        "a_monitor_of_its_own", TESTS, "hides the fixture `monitor` behind a fixture that never fails", "NOT JUDGED, which fails"
    ),
    Entry(
        "a_rule_of_its_own",
        TESTS,
        "hides the fixture `rule` behind a fixture with a harmless rule",
        "ERROR: this can't be the verdict of the item",
    ),
    Entry(
        "parametrize_the_rule",
        TESTS,
        "sets the rule of its items by `pytest.mark.parametrize`",
        "ERROR: this can't be the verdict of the item",
    ),
    Entry("another_rule_by_that_name", TESTS, "checks a harmless rule under the name p1", "ERROR: p1 says something else"),
    Entry(
        "change_the_run_in_place",
        TESTS,
        "sets the speeds of the run to zero before it is judged",
        "ERROR: runs can't be written to",
    ),
    Entry("open_is_a_pass_so_fail_is", TESTS, "breaks a rule in a session that lets OPEN and UNAVOIDABLE pass", "FAIL"),
    Entry(
        "xfail_without_a_reason_over_an_error",
        TESTS,
        "marks a test as xfail whose controller raises",
        "ERROR, not an expected failure",
    ),
    Entry(
        "xfail_over_an_error",
        TESTS,
        "marks a test as xfail, with a reason, whose controller raises",
        "ERROR, not an expected failure",
    ),
    Entry(
        "known_over_an_error",
        TESTS,
        "marks an error of its controller as a known deficiency",
        "ERROR, not a known failure",
    ),
    Entry("xfail_over_a_typo", TESTS, "marks as xfail a test that dies of a misspelt name", "ERROR, not an expected failure"),
    Entry("xfail_over_a_broken_fixture", TESTS, "marks as xfail a test whose fixture raises", "ERROR, not an expected failure"),
    Entry(
        "a_run_made_elsewhere",
        TESTS,
        "hides the fixture from which `run` and `monitor` are made behind its own fixture",
        "ERROR: nothing was simulated",
    ),
    Entry(
        "known_over_a_pass",
        TESTS,
        "marks a passing item as a known deficiency",
        "the test fails, because a known deficiency has to fail",
    ),
    Entry(
        "known_that_matches_nothing",
        TESTS,
        "marks cells as known whose rule the class does not ask for",
        "the session is refused",
    ),
    Entry(
        "assert_on_a_run_that_broke_off",
        TESTS,
        "asserts that nobody crashed, in a run that broke off early",
        "ERROR",
    ),
    Entry(
        "end_before_it_gets_in",
        TESTS,
        "ends the run before an event that a rule asks for",
        "OPEN, which fails",
    ),
    # Sessions that judge nothing.
    Entry("nothing_but_na", SESSIONS, "asks only for rules that don't apply", "NA; exit status 5, nothing was judged"),
    Entry(
        "catch_the_skip_of_na",
        SESSIONS,
        "catches the skip of a rule that does not apply, so that the test passes",
        "NA; exit status 5, nothing was judged",
    ),
    Entry(
        "nothing_but_provoked",
        SESSIONS,
        "asks for a rule that only traffic breaks",
        "PROVOKED; exit status 5, nothing was judged",
    ),
    Entry(
        "nothing_but_unavoidable",
        SESSIONS,
        "asks only for a rule that nobody could have kept",
        "UNAVOIDABLE; exit status 5, nothing was judged",
    ),
    Entry(
        "a_rule_that_never_applies",
        SESSIONS,
        "asks for a rule of its own whose condition can't hold",
        "NA; exit status 5, nothing was judged",
    ),
    Entry(
        "nothing_but_unsure",
        SESSIONS,
        "judges nothing but recordings that are too inexact to tell",
        "UNSURE; exit status 5, nothing was judged",
    ),
    Entry(
        "pass_over_what_is_unsure",
        SESSIONS,
        "asks for a verdict that depends on the accuracy of a recording, and asserts nothing",
        "UNSURE; exit status 5, nothing was judged",
    ),
    Entry("skip_everything", SESSIONS, "skips all its tests", "NOT RUN; exit status 5, nothing was judged"),
    Entry("no_time_for_anything", SESSIONS, "sets a time budget of 0 s", "NOT RUN; exit status 5, nothing was judged"),
    Entry(
        "everybody_arrives_at_once",
        SESSIONS,
        "lets all vehicles arrive at the same time, so that no vehicle comes a second later",
        "the last line says that no gap between arrivals was tried; exit status 1 if gaps are asked for",
    ),
    # Sessions in which nothing of the user's drives, or something is left out.
    Entry(
        "nobody_drives",
        SESSIONS,
        "names no driver, so that the bundled autopilot drives",
        "exit status 1: nothing of yours was tested",
    ),
    Entry(
        "misspelt_fixture",
        SESSIONS,
        "calls its fixture rvads_autopliot",
        "exit status 1, and a question whether the name is misspelt",
    ),
    Entry("fixture_next_door", SESSIONS, "has its fixture in another test file", "exit status 1, and the place of the fixture"),
    Entry(
        "let_the_reference_drive",
        SESSIONS,
        "lets the reference autopilot drive by an option",
        "the verdicts of the reference; every record names the reference as the driver",
    ),
    Entry(
        "drop_what_fails",
        SESSIONS,
        "has a plugin drop the items that fail after collection",
        "NOT RUN; exit status 1, and the number of missing items",
    ),
    Entry(
        "drop_before_anybody_looks",
        SESSIONS,
        "has a wrapper around the collection drop the items that fail, before any plugin sees them",
        "NOT RUN; exit status 1, and the number of missing items",
    ),
    Entry(
        "catch_failures_outside",
        SESSIONS,
        "has a wrapper around the tests catch their failures",
        "FAIL; exit status 1, and a note that something catches failures",
    ),
    Entry(
        "change_the_outcome",
        SESSIONS,
        "has a hook turn the reports of failures into passed ones",
        "FAIL; exit status 1, and a note that something catches failures",
    ),
    Entry(
        "deselect_what_fails",
        SESSIONS,
        "deselects failing items by `-k`, and asks for full coverage",
        "exit status 1: items that were not selected still count as planned",
    ),
    Entry("three_tests_on_one_run", SESSIONS, "judges one run in three tests, to confuse the summary", "FAIL three times"),
    # Sessions beside an earlier report, of which only new failures count.
    Entry("break_down_where_it_failed_before", SESSIONS, "is an ERROR now where it was a FAIL", "exit status 1: NEW"),
    Entry("fail_where_it_broke_down_before", SESSIONS, "is a FAIL now where it was an ERROR", "exit status 1: NEW"),
    Entry("ask_nothing_any_more", SESSIONS, "makes its runs so short that the rule does not apply any more", "no success: LOST"),
    Entry("skip_what_was_judged", SESSIONS, "skips the test that failed before", "exit status 1: LOST"),
    Entry("judge_nothing_as_before", SESSIONS, "judges nothing, as in the session of the baseline", "exit status 1: NOT JUDGED"),
    Entry("delete_the_test", SESSIONS, "deletes the test that failed", "exit status 1: LOST"),
    Entry("call_it_known", SESSIONS, "marks an item as known that passed before and fails now", "the comparison names it: KNOWN"),
    Entry(
        "another_map_under_the_same_name",
        SESSIONS,
        "judges another junction under the same name",
        "exit status 1: LOST, because the junction has changed",
    ),
    Entry(
        "shard_that_judged_nothing",
        SESSIONS,
        "merges a shard that passed with a shard that skipped everything",
        "coverage counts the items that did not run; the skipped shard alone has exit status 5",
    ),
    # Recorded runs.
    Entry("reverse_away", RECORDINGS, "backs off from the line at green", "`progress` FAIL: driving backwards is not getting on"),
    Entry(
        "to_and_fro_inside",
        RECORDINGS,
        "drives to and fro in the junction at 2 m/s for half a minute",
        "`progress` FAIL: the vehicle moves and gets nowhere",
    ),
    Entry("too_fast_backwards", RECORDINGS, "drives backwards faster than the limit", "`speed_limit` FAIL"),
    Entry(
        "drive_on_after_a_crash",
        RECORDINGS,
        "runs a red light, touches a vehicle, and drives on",
        "`red` FAIL, `no_collision` FAIL",
    ),
    Entry(
        "cut_in_on_the_exit_road",
        RECORDINGS,
        "cuts in on the exit road, less than a second ahead of another, and slows down",
        "`no_collision` FAIL by the vehicle that cut in, not by the vehicle behind",
    ),
    Entry(
        "reverse_into_who_follows",
        RECORDINGS,
        "reverses into a vehicle that slowly comes up from behind",
        "`no_collision` FAIL by the vehicle that reversed",
    ),
    Entry(
        "two_bodies_in_one_place",
        RECORDINGS,
        "does not record collisions, and has two vehicles in one place",
        "`no_collision` FAIL, from the poses",
    ),
    Entry(
        "crash_struck_out",
        RECORDINGS,
        "says that nobody collided, and has two vehicles in one place",
        "not believed: `no_collision` FAIL, or a finding",
    ),
    Entry("without_positions", RECORDINGS, "records only zones", "rules that need positions are NA, not recorded"),
    Entry("empty_run", RECORDINGS, "holds no states at all", "ERROR"),
    Entry("nan_in_the_run", RECORDINGS, "holds NaN where the speeds were too high", "ERROR"),
    Entry("subject_that_is_not_there", RECORDINGS, "names as its subject a vehicle that is not in the run", "ERROR"),
    Entry("two_by_one_name", RECORDINGS, "calls two vehicles by the name of the subject", "ERROR"),
    Entry(
        "straight_on_called_a_right_turn",
        RECORDINGS,
        "goes straight on at red and calls it a right turn",
        "`red` FAIL: the movement counts",
    ),
    Entry(
        "speeds_set_to_zero",
        RECORDINGS,
        "runs the sign with all its speeds set to zero",
        "a warning that places and speeds don't agree",
    ),
    Entry(
        "violation_cut_out",
        RECORDINGS,
        "cuts out the seconds in which the vehicle runs the sign",
        "a warning that the vehicle jumps; the exit status of `rvads check` is not 0",
    ),
    Entry(
        "light_painted_green",
        RECORDINGS,
        "makes the red light green for the moment of the entry",
        "a finding: the light changes out of order",
    ),
    Entry(
        "vehicles_made_thin",
        RECORDINGS,
        "makes the vehicles of a kept run so thin that nothing touches",
        "the hash differs from the hash in the report",
    ),
    Entry(
        "one_file_is_no_recording",
        RECORDINGS,
        "has a file that can't be read among its recordings",
        "ERROR, which names the file; the other recordings are judged",
    ),
    Entry(
        "no_recordings_at_all",
        RECORDINGS,
        "asks for recordings of which there are none",
        "the test is refused",
    ),
    Entry(
        "nothing_applies",
        RECORDINGS,
        "has `rvads check` judge a run by rules that don't apply",
        "NA; exit status 5, nothing was judged",
    ),
    # Rules and searches.
    Entry(
        "rule_without_always", SEARCHES, "writes a rule that asks for something in the first state only", "the rule is refused"
    ),
    Entry(
        "predicate_that_is_just_true",
        SEARCHES,
        "writes a predicate that returns True",
        "ERROR: one truth value per state is needed",
    ),
    Entry("no_rules_at_all", SEARCHES, "asks for an empty list of rules", "the test is refused"),
    Entry("redefine_a_shipped_rule", SEARCHES, "registers a harmless rule as p1", "the rule is refused"),
    Entry(
        "one_name_for_two_rules",
        SEARCHES,
        "registers a harmless rule by the name that another file uses",
        "the second file is refused",
    ),
    Entry(
        "search_where_nothing_applies",
        SEARCHES,
        "looks for counterexamples to a rule that never applies",
        "an error: nothing was tried",
    ),
    Entry(
        "compare_where_nothing_applies",
        SEARCHES,
        "compares equivalent scenarios to which no rule applies",
        "an error: nothing was tried",
    ),
)

INNOCENTS = (
    # Driving as one may.
    Entry("stop_for_a_moment", DRIVING, "stands at the stop sign for half a second only", "`full_stop` PASS"),
    Entry(
        "hesitate_for_three_seconds",
        DRIVING,
        "waits for 3 s when it could go, and drives slowly",
        "`full_stop` PASS, `progress` PASS",
    ),
    Entry(
        "creep_the_last_two_metres",
        DRIVING,
        "creeps the last two metres to the line and stops",
        "`full_stop` PASS, `progress` PASS",
    ),
    Entry("stop_at_the_last_moment", DRIVING, "brakes for the stop sign at the last moment, and hard", "`full_stop` PASS"),
    Entry("drive_slowly_all_the_way", DRIVING, "drives at 2 m/s all the way", "`progress` PASS, `keep_clear` PASS"),
    Entry("wait_for_eight_seconds", DRIVING, "waits at the stop sign for eight seconds", "`progress` PASS"),
    Entry("a_little_over_the_limit", DRIVING, "drives 0.2 m/s over the limit", "`speed_limit` PASS"),
    Entry(
        "brake_on_yellow", DRIVING, "stops for a yellow light and waits until it is green again", "`red` PASS, `progress` PASS"
    ),
    Entry("pass_on_yellow_when_too_near_to_stop", DRIVING, "passes on yellow when it is too near to stop", "`red` NA"),
    Entry("wait_at_red", DRIVING, "waits at a red light for as long as it is red", "`red` PASS, `progress` PASS"),
    Entry("right_on_red_after_a_stop", DRIVING, "stops at a red light and turns right when nobody comes", "`right_on_red` PASS"),
    Entry(
        "wait_for_green_to_turn_right",
        DRIVING,
        "waits for green although it may turn right on red",
        "`right_on_red` PASS, `progress` PASS",
    ),
    Entry("keep_left_at_stop_signs", DRIVING, "stops at a sign where traffic keeps left", "`full_stop` PASS, `keep_lane` PASS"),
    Entry(
        "keep_left_and_turn_left_on_red",
        DRIVING,
        "stops at a red light where traffic keeps left, and turns left",
        "`right_on_red` PASS, `red` NA",
    ),
    Entry(
        "swing_out_in_a_narrow_corner",
        DRIVING,
        "swings out with its front in a narrow bend, as cars do",
        "`keep_lane` PASS, `on_route` PASS",
    ),
    # What others do.
    Entry(
        "cross_on_green_and_be_hit",
        CONFLICTS,
        "crosses on green and is hit by a vehicle that runs the red light",
        "`red`, `no_conflict`, `no_collision` PROVOKED",
    ),
    Entry(
        "be_cut_off_by_who_runs_the_sign",
        CONFLICTS,
        "is in the junction when another vehicle runs the sign and hits it",
        "`full_stop`, `no_conflict`, `no_collision` PROVOKED",
    ),
    Entry(
        "meet_who_comes_in_the_wrong_lane",
        CONFLICTS,
        "collides head-on with a vehicle that comes in its lane",
        "`keep_lane` PROVOKED, `no_collision` PROVOKED",
    ),
    Entry(
        "leave_the_junction_and_be_hit_by_who_runs_a_red_light",
        CONFLICTS,
        "waits in the middle to turn left, leaves when the light of the oncoming vehicle is red, and is hit by it",
        "`red`, `no_conflict`, `no_collision` PROVOKED; `left_yields` does not blame the driver",
    ),
    Entry(
        "traffic_runs_the_sign",
        CONFLICTS,
        "keeps the rules beside a vehicle that rolls over the stop line",
        "`full_stop` PROVOKED",
    ),
    Entry("traffic_runs_a_red_light", CONFLICTS, "keeps the rules beside a vehicle that runs a red light", "`red` PROVOKED"),
    Entry(
        "traffic_leaves_its_route",
        CONFLICTS,
        "keeps the rules beside a vehicle that leaves its route and ends the run",
        "`on_route`, `keep_lane` PROVOKED; its own rules PASS",
    ),
    Entry(
        "others_crash",
        CONFLICTS,
        "is on its way when two other vehicles crash, which ends the run",
        "`left_yields`, `no_conflict`, `no_collision` PROVOKED",
    ),
    Entry(
        "wait_for_who_never_goes",
        CONFLICTS,
        "waits for a vehicle that came first to an all-way stop and never goes",
        "`first_come` PROVOKED, `progress` PROVOKED",
    ),
    Entry(
        "wait_at_red_until_others_crash",
        CONFLICTS,
        "waits at red when two other vehicles crash, which ends the run",
        "`red`, `left_yields`, `no_conflict`, `no_collision` PROVOKED",
    ),
    Entry(
        "wait_for_who_turns_left_and_stops",
        CONFLICTS,
        "waits at green for a left-turner that stands across its way",
        "`keep_clear` PROVOKED, `progress` PROVOKED",
    ),
    Entry(
        "wait_at_the_line_for_a_blocked_exit",
        CONFLICTS,
        "waits at the line because a vehicle on its exit road leaves no room",
        "`progress` PROVOKED",
    ),
    Entry(
        "wait_inside_behind_who_pushed_in",
        CONFLICTS,
        "stands in the junction behind a vehicle that turned into its exit road ahead of it and stopped there",
        "`full_stop` PROVOKED, `progress` PROVOKED; `keep_clear` does not blame the driver",
    ),
    Entry(
        "wait_for_who_blocks_the_junction",
        CONFLICTS,
        "waits at the stop sign for a vehicle that stands in the junction",
        "`keep_clear` PROVOKED, `progress` PROVOKED",
    ),
    Entry(
        "wait_in_the_middle_for_a_slow_one",
        CONFLICTS,
        "waits in the middle for nine seconds to let a slow oncoming vehicle pass",
        "`left_yields` PASS, `keep_clear` PASS, `progress` PASS",
    ),
    Entry(
        "pass_a_left_turner_that_waits",
        CONFLICTS,
        "drives past a left-turner that waits in the middle",
        "`no_conflict` PASS",
    ),
    Entry(
        "right_on_red_with_a_large_gap",
        CONFLICTS,
        "turns right on red when the vehicle with green is far away",
        "`right_on_red` PASS",
    ),
    Entry(
        "left_turn_with_a_large_gap",
        CONFLICTS,
        "turns left when the oncoming vehicle is far away",
        "`no_conflict` PASS; `left_yields` does not blame the driver",
    ),
    Entry(
        "tie_of_two_that_face_each_other",
        CONFLICTS,
        "comes to an all-way stop together with the opposite vehicle, and both go straight on",
        "`full_stop` PASS; `first_come` NA, `right_first` NA",
    ),
    Entry(
        "go_first_of_four",
        CONFLICTS,
        "goes first when four vehicles come to an all-way stop at once",
        "`right_first` UNAVOIDABLE: one vehicle has to go first",
    ),
    Entry(
        "see_another_go_first_of_four",
        CONFLICTS,
        "waits when four vehicles come to an all-way stop at once and another goes first",
        "`right_first` UNAVOIDABLE",
    ),
    # The reference autopilot, at an all-way stop and at lights, among every policy of traffic.
    Entry(
        "reference_among_reference", CONFLICTS, "keeps the rules among vehicles that keep them, too", "no FAIL, no OPEN, no ERROR"
    ),
    Entry("reference_among_hesitant", CONFLICTS, "keeps the rules among others that hesitate", "no FAIL, no OPEN, no ERROR"),
    Entry(
        "reference_among_rolling_stop",
        CONFLICTS,
        "keeps the rules among others that roll over stop lines",
        "no FAIL, no OPEN, no ERROR",
    ),
    Entry(
        "reference_among_late_yielder", CONFLICTS, "keeps the rules among others that brake late", "no FAIL, no OPEN, no ERROR"
    ),
    Entry(
        "reference_among_red_light_runner",
        CONFLICTS,
        "keeps the rules among others that stop for nothing",
        "no FAIL, no OPEN, no ERROR",
    ),
    Entry("reference_among_stopped", CONFLICTS, "keeps the rules among others that never go", "no FAIL, no OPEN, no ERROR"),
    Entry(
        "reference_among_lgsvl",
        CONFLICTS,
        "keeps the rules among others with the deficiencies of the paper's autopilot",
        "no FAIL, no OPEN, no ERROR",
    ),
    Entry(
        "hit_who_darts_onto_the_crosswalk",
        PEDESTRIANS,
        "drives over a crosswalk when a pedestrian runs out too near to stop",
        "`crosswalk`, `no_conflict`, `no_collision` PROVOKED",
    ),
    Entry(
        "hit_who_comes_out_behind_a_parked_vehicle_at_a_moderate_speed",
        PEDESTRIANS,
        "passes a parked vehicle at 23 km/h when a pedestrian comes out from behind it, too near to stop",
        "`crosswalk`, `no_conflict`, `no_collision` PROVOKED",
    ),
    Entry(
        "hit_who_steps_out_against_the_light",
        PEDESTRIANS,
        "drives on at green when a pedestrian steps out against the pedestrian light, too near to stop",
        "`no_conflict`, `no_collision` PROVOKED",
    ),
    Entry(
        "wait_on_the_edge_for_who_stops_half_way",
        PEDESTRIANS,
        "stops with its front on a crosswalk for a pedestrian, who then stands still half way",
        "`crosswalk` PASS, `crosswalk_clear` PASS",
    ),
    Entry(
        "wait_for_who_stands_on_the_crosswalk",
        PEDESTRIANS,
        "waits for ten seconds for a pedestrian who crosses slowly and stands still half way",
        "`crosswalk` PASS, `progress` PASS",
    ),
    # Recorded runs.
    Entry("hit_from_behind_at_the_line", RECORDINGS, "waits at the stop sign and is hit from behind", "`no_collision` PROVOKED"),
    Entry(
        "hit_from_behind_at_red",
        RECORDINGS,
        "waits at a red light and is hit from behind, which ends the run",
        "`no_collision` PROVOKED, `red` PROVOKED",
    ),
    Entry("queue_behind_another", RECORDINGS, "stands at green behind a vehicle that does not go", "`progress` PROVOKED"),
    Entry(
        "no_time_to_react",
        RECORDINGS,
        "enters less than a second after a vehicle that runs the sign",
        "p1 PROVOKED, `full_stop` PROVOKED",
    ),
)

UNWATCHED = (
    Entry(
        "yellow_that_it_could_have_stopped_for",
        DRIVING,
        "enters on yellow, although it could have stopped",
        "`red` NA: the rule binds only vehicles that enter on red",
    ),
    Entry("slow_driving", DRIVING, "drives at 2 m/s where 11 m/s are allowed", "`progress` PASS: walking pace is progress"),
    Entry(
        "tailgating",
        CONFLICTS,
        "follows another vehicle at 10 m/s and a distance of 1 m",
        "`no_collision` PASS: no vehicle was touched",
    ),
    Entry(
        "brake_test",
        CONFLICTS,
        "brakes hard on the road for no reason, so that the vehicle behind has to",
        "`no_collision` PASS: no vehicle was touched",
    ),
)
