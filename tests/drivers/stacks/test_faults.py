"""A stack that fails is an error, never a verdict; it names the stack, and the next scenario is served."""

import random
from collections.abc import Callable

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.stacks import messages
from pytest_rvads.drivers.stacks.child import StackError, StackTimeout
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.runs.run import Run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import AutopilotError

Make = Callable[..., Process]
STRAY = "to its standard output, which carries the protocol: print to standard error instead"
AT_DECISION = {
    "crash": "it exited with status 1 before it answered",
    "segfault": "it was killed by signal SIGSEGV",
    "hang": "it did not answer within 1 s",
    "late": "it did not answer within 1 s",
    "nan": "returned throttle nan, expected a finite number",
    "inf": "returned a target speed inf, expected a finite number",
    "text": "its command is not as the protocol has it: Expected `float | null`, got `str` - at `$.brake`",
    "range": "returned throttle 1.5, expected 0..1",
    "degrees": "returned steering 30, expected radians within -pi/2..pi/2 (was it in degrees?)",
    "speed": "returned a target speed -3 m/s, expected 0 to 70",
    "points": "returned a trajectory of 1 points, expected at least 2",
    "empty": "its command says nothing: expected throttle, brake and steering; target_speed; acceleration; or trajectory",
    "type": "it sent a message of type 'ready', expected 'command'",
    "step": "it answered step None, expected step 3: answer every observation once",
    "garbage": STRAY,
    "print": f"it wrote 'loading weights ... done' {STRAY}",
    "huge": "its command is not as the protocol has it: Number out of range - at `$.target_speed`",
    "bool": "its command is not as the protocol has it: Expected `float | null`, got `bool` - at `$.target_speed`",
    "deep": STRAY,
    "compute": "it says that it computed for nan s, expected 0 to 86400",
    "crowded": "its trajectory has 10001 points, expected at most 10000",
    "flood": "bytes without the end of a line, expected at most 16,777,216",
    "close": "it closed its standard input or output and went on",
}
"""What is said of each fault."""
SCENARIO = Scenario(find("stop4"), "2000", distance=20, speed=5, duration=0.5)


def drive(stack: Process, scenario: Scenario = SCENARIO) -> Run:
    return simulate(Case(scenario, stack))


@pytest.mark.extended
@pytest.mark.parametrize("fault", AT_DECISION)
def test_a_fault_ends_the_run_and_says_what_happened(faulty: Make, fault: str) -> None:
    run = drive(faulty(fault))
    assert run.fault is not None
    assert run.fault.reason.startswith("stack ")
    assert "faulty.py" in run.fault.reason
    assert " driving a0 at 0.10 s" in run.fault.reason, "the third decision at 20 Hz"
    assert AT_DECISION[fault] in run.fault.reason
    assert run.fault.detail.endswith("cannot open the map" if fault == "crash" else f"last words of {fault}")
    assert run.steps == 11, "the states up to there are kept"
    assert check(run, "p1").status == "ERROR"


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("version", "it speaks version 1 of the protocol, expected 2: build it with the client of this version"),
        ("name", "it speaks version 1 of the protocol, expected 2: build it with the client of this version"),
        ("format", "it wants the format '\\x1b[2J\\x1b[2J\\x1b[2J\\x1b[2J\\x1b[2J', expected json or binary"),
        ("rate", "its rate must divide 100 Hz, such as 10, 20, 25 or 50, got 7"),
        ("tiny", "its rate must divide 100 Hz, such as 10, 20, 25 or 50, got 5e-324"),
        ("huge rate", "its hello is not as the protocol has it: Number out of range - at `$.rate`"),
        ("nan rate", "its rate must divide 100 Hz, such as 10, 20, 25 or 50, got nan"),
        ("mute", "it did not answer within 0.3 s"),
        ("unready", "it exited with status 4 before it answered"),
    ],
)
def test_stack_that_does_not_start_is_a_fault(faulty: Make, fault: str, says: str) -> None:
    run = drive(faulty(fault, startup=0.3 if fault == "mute" else 60.0))
    assert run.fault is not None
    assert "faulty.py" in run.fault.reason
    assert says in run.fault.reason
    assert run.steps == 1


def test_slow_stack_is_a_timeout_and_a_failing_stack_is_not(faulty: Make) -> None:
    agents = Case(SCENARIO, Reference).agents()
    with pytest.raises(StackTimeout, match=r"faulty.py mute 1 3: it did not answer within 0.3 s"):
        faulty("mute", startup=0.3).autopilots(agents)
    with pytest.raises(StackError, match="it speaks version 1") as error:
        faulty("version").autopilots(agents)
    assert not isinstance(error.value, StackTimeout)


@pytest.mark.parametrize(("command", "says"), [("./no-such-stack", "No such file"), ("/etc/passwd", "Permission denied")])
def test_a_program_that_can_t_be_started_is_an_error(command: str, says: str) -> None:
    run = drive(Process(command))
    assert run.fault is not None
    assert run.fault.reason.startswith(f"stack {command}: it can't be started: {says}")


def test_program_without_the_protocol_is_named_in_the_fault() -> None:
    assert "exited with status 0 before it answered" in drive(Process("true")).fault.reason
    run = drive(Process(["echo", "hello", "world"]))
    assert "it wrote 'hello world' to its standard output, which carries the protocol" in run.fault.reason


@pytest.mark.extended
@pytest.mark.parametrize("count", [30, pytest.param(100, marks=pytest.mark.slow)])
def test_all_injected_faults_are_errors_and_the_other_runs_go_on(faulty: Make, count: int) -> None:
    """Every kind of fault, at decisions drawn at random, with a good run before and after."""
    draw = random.Random(8)
    good = drive(faulty("none"))
    errors = 0
    for number in range(count):
        fault = list(AT_DECISION)[number % len(AT_DECISION)]
        stack = faulty(fault, scenario=1, decision=draw.randint(1, 10))
        run = drive(stack)
        errors += check(run, "p1").status == check(run, "full_stop").status == "ERROR"
        assert run.fault.reason.startswith(f"{stack.label} driving a0"), run.fault
        assert run.label in ("stop4-class00-as2000-cfgd20.00v05.00",)
        stack.close()
    assert errors == count >= len(AT_DECISION)
    assert drive(faulty("crash", scenario=2)).hash == good.hash


@pytest.mark.extended
@pytest.mark.parametrize("fault", ["crash", "hang", "nan", "print", "close"])
def test_a_new_process_serves_the_scenarios_after_a_fault(faulty: Make, fault: str) -> None:
    good = drive(faulty("none"))
    stack = faulty(fault, scenario=2)
    runs = [drive(stack) for _ in range(3)]
    assert [run.fault is None for run in runs] == [True, False, True], "the new process counts its scenarios anew"
    assert runs[0].hash == runs[2].hash == good.hash


def test_the_same_fault_gives_the_same_run(faulty: Make) -> None:
    assert drive(faulty("garbage")).hash == drive(faulty("garbage")).hash


def test_repeated_answer_is_a_fault(faulty: Make) -> None:
    run = drive(faulty("twice", decision=3))
    assert run.fault.reason.endswith("at 0.15 s: it answered step 3, expected step 4: answer every observation once")
    # Ten decisions make a run: after the last one, the next scenario notices.
    stack = faulty("twice", decision=10)
    assert drive(stack).fault is None
    assert drive(stack).fault.reason.endswith("at 0.00 s: it sent a message of type 'command', expected 'ready'")
    assert drive(stack).fault is None


def test_an_answer_to_a_question_that_was_not_asked_is_refused(faulty: Make) -> None:
    run = drive(faulty("ahead"))
    assert 'at 0.15 s: it wrote \'{"type": "command", "target_speed": 5, "step": 4}\\n\' before it was asked' in run.fault.reason
    assert run.fault.reason.endswith("read a message, then answer it once")


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("cat /dev/zero", "bytes without the end of a line, expected at most 16,777,216"),
        ("yes", "it wrote 'y' to its standard output, which carries the protocol"),
        ("echo '{0}\"json\"}}'; read l; cat /dev/zero", "bytes without the end of a line, expected at most 16,777,216"),
        ("echo '{0}\"binary\"}}'; read l; cat /dev/zero", "it wrote '\\x00"),
        ("echo '{0}\"binary\"}}'; read l; yes", "it wrote 'y\\ny\\n"),
        ("echo '{0}\"binary\"}}'; read l; printf '\\002\\000\\000\\000\\377\\377\\377\\177'; sleep 50", "it wrote '\\x02\\x00"),
        ("exec 0<&- 1>&-; sleep 50", "it closed its standard input or output and went on"),
    ],
)
def test_what_a_program_writes_is_read_within_bounds(script: str, says: str) -> None:
    """Five seconds are enough for the memory of a machine, and what is not refused before ends with them."""
    hello = '{"type": "hello", "version": 2, "format": '
    with Process(["sh", "-c", script.format(hello)], startup=5.0) as stack:
        reason = drive(stack).fault.reason
    assert says in reason
    assert len(reason) < 1500


def test_control_characters_in_a_stack_name_are_escaped(faulty: Make) -> None:
    stack = Process(["./no-such-stack", "\x1b[2J" * 1000, "\0"])
    assert stack.label.startswith(r"stack ./no-such-stack '\x1b[2J\x1b[2J")
    assert drive(stack).fault.reason.startswith(f"{stack.label}: it can't be started: ")


def test_one_process_for_subject_and_traffic_is_refused(faulty: Make) -> None:
    stack = faulty("none")
    run = simulate(Case(Scenario(find("stop4"), "2200", duration=0.5, subject=0), stack, traffic=stack))
    assert "it serves two vehicles at once: give the traffic a Process of its own" in run.fault.reason


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"command": []}, "a stack needs a command"),
        ({"command": "./stack", "rate": 30}, "its rate must divide 100 Hz, such as 10, 20, 25 or 50, got 30"),
        ({"command": "./stack", "rate": "fast"}, "its rate must divide 100 Hz, .*got 'fast'"),
        ({"command": "./stack", "timeout": 0}, "timeout must be a number of seconds above 0, got 0"),
        ({"command": "./stack", "grace": -1}, "grace must be a number of seconds above 0, got -1"),
        ({"command": "./stack", "startup": float("nan")}, "startup must be a number of seconds above 0, got nan"),
    ],
)
def test_invalid_arguments_of_a_process_are_refused(arguments: dict[str, object], says: str) -> None:
    with pytest.raises(AutopilotError, match=says):
        Process(**arguments)  # type: ignore[arg-type]


def test_the_traffic_may_be_a_stack_too(faulty: Make) -> None:
    run = simulate(Case(Scenario(find("stop4"), "2202", duration=0.5, subject=0), Reference, traffic=faulty("none")))
    assert run.fault is None
    assert set(run.provenance["timing"]) == {"a1", "a3"}


@pytest.mark.parametrize(
    "content", [b'"throttle":0.1,"target_speed":5', b'"target_speed":5,"acceleration":1', b'"brake":0,"trajectory":[]']
)
def test_a_command_that_says_two_things_is_refused(content: bytes) -> None:
    answer = messages.read(b'{"type":"command",' + content + b"}", messages.Answer)
    with pytest.raises(StackError, match=r"its command says \S+.* and .*: expected throttle, brake and steering; "):
        answer.command()
