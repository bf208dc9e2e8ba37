"""A session of 3,000 verdicts, of the size that pages are looked at with."""

from msgspec import structs

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.report.record import AgentRecord, Record, SimulatedItem, conclude, planned_record
from pytest_rvads.report.session_report import Report, cell_of, in_order

RULES = ("p1", "p2", "p3", "full_stop", "right_on_red")
WRONG = (
    ("F a0@j: due, and never in the junction", "a0 does not enter the junction"),
    ("G !(a0@j & a1@j & conflict(a0,a1)): both in", "both in the junction on ways that cross"),
    ("first(a1,a0) -> !a0@j U a1@x: entered", "entered before the one who came first had left"),
    ("right(a1,a0) -> !a0@j U a1@x: entered", "entered before the one on its right had left"),
    ("stopped(a0) before a0@j: at 2.3 m/s", "entered at 2.3 m/s, the slowest was 1.1 m/s"),
    ("red(a0) -> !a0@j: entered", "entered the junction 0.6 s after its light turned red"),
    ("a0 touches a1", "collision with a1 at 4.1 m/s"),
    ("a0 leaves its lane by 0.4 m", "its body was 0.4 m outside its lane"),
)


def large_session() -> Report:
    """Two junctions, fifteen classes, twenty long configurations and five rules: 600 runs, 300 failures, fifteen causes."""
    records = [
        _record(place, cls, cfg, n)
        for place in ("stop4", "light4")
        for cls in range(1, 16)
        for cfg in range(20)
        for n in range(5)
    ]
    seconds = {f"test_rules[{one.run}]": 0.2 + one.cls / 10 for one in records if isinstance(one, SimulatedItem)}
    return Report(
        in_order(records),
        {4: (24, 81)},
        tuple(map(cell_of, records)),
        {"pytest-rvads": "0.2.0", "pybullet": "3.2.7", "numpy": "2.1.0"},
        1,
        seconds=seconds,
        began="2026-11-23T12:46:18+00:00",
        command="pytest tests/test_pilots.py --rvads-report=verdicts.html -n 4",
    )


def _record(place: str, cls: int, cfg: int, number: int) -> Record:
    rule = RULES[number]
    label = f"d{10 + cfg:05.2f},12.50v{5 + cfg % 4:05.2f},08.33"
    run = f"{place}-class{cls:02d}-as11{cls:02d}-cfg{label}"
    keys: dict[str, str | int] = {
        "junction": place,
        "control": "stop" if place == "stop4" else "lights",
        "cls": cls,
        "scenario": f"11{cls:02d}",
        "cfg": label,
        "rotation": 0,
        "rule": rule,
        "driver": "pilots.hurried.HurriedPilot",
        "simulator": "bullet 3.2.7",
    }
    made = planned_record(f"tests/test_pilots.py::test_rules[{run}-{rule}]", 12, "test_rules", keys, 4)
    agents = tuple(AgentRecord(name=f"a{n}", kind="car", entrance=(n, 0), exit=((n + 2) % 4, 0)) for n in range(4))
    made = structs.replace(made, run=run, hash=f"{run} hash", agents=agents, source="pilots/hurried.py 3fa29c01")
    many = (cls - 1) * 20 + cfg
    wrong = many % 4 == 0 and number in (many % 3, many % 3 + 1)
    if not wrong:
        idle = rule == "right_on_red" or (rule == "full_stop" and place == "light4")
        status = "NA" if idle else "PASS"
        text = f"{rule} NA: no instance was ever triggered" if idle else ""
        return conclude(made, [Verdict(rule, Status(status), text)], "call", "skipped" if idle else "passed", text=text)
    cause = many // 4 % 15
    formula, said = WRONG[cause % 8]
    verdict = Verdict(
        rule,
        Status.FAIL if cause < 8 else Status.OPEN,
        said,
        title="who came first goes first",
        time=3.0 + number,
        violated=formula,
        roles=f"from {cause % 4}, straight on",
    )
    text = (
        f"{rule} at t={3 + number:.2f} s: {said} (a0 at entrance 0 to 2, a1 at entrance 1 to 3; who came first goes first)\n"
        f"       since t=1.20 s, a0 waited 0.00 s; a1 is to blame for nothing here, it came 0.84 s earlier and stood at its line"
    )
    look = f".rvads/{run}-{rule}.html#t={3 + number:.2f}" if many % 8 == 0 else ""
    return conclude(structs.replace(made, look=look), [verdict], "call", "failed", text=text)
