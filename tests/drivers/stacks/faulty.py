"""A stack that goes wrong when told to: ``faulty.py FAULT SCENARIO DECISION``; written against the protocol, not a client."""

import json
import os
import signal
import sys
import time
from collections.abc import Callable

fault, scenario, decision = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])


def say(content: dict[str, object]) -> None:
    os.write(1, json.dumps({"step": asked} | content).encode() + b"\n")


def ahead() -> None:
    answers = ({"type": "command", "target_speed": 5, "step": asked + k} for k in (0, 1))
    os.write(1, b"".join(json.dumps(answer).encode() + b"\n" for answer in answers))


FAULTS: dict[str, Callable[[], object]] = {
    "crash": lambda: sys.exit("cannot open the map"),
    "segfault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "hang": lambda: [time.sleep(50), sys.exit()],  # type: ignore[func-returns-value]
    "late": lambda: time.sleep(2),
    "nan": lambda: say({"type": "command", "throttle": float("nan")}),
    "inf": lambda: say({"type": "command", "target_speed": float("inf")}),
    "text": lambda: say({"type": "command", "brake": "full"}),
    "range": lambda: say({"type": "command", "throttle": 1.5}),
    "degrees": lambda: say({"type": "command", "steering": 30}),
    "speed": lambda: say({"type": "command", "target_speed": -3}),
    "points": lambda: say({"type": "command", "trajectory": [[0, 1, 2]]}),
    "empty": lambda: say({"type": "command"}),
    "type": lambda: say({"type": "ready"}),
    "garbage": lambda: os.write(1, b"\xff\xfe\x00{]\n"),
    "print": lambda: os.write(1, b"loading weights ... done\n"),
    "twice": lambda: say({"type": "command", "target_speed": 5.0}),
    "step": lambda: say({"type": "command", "target_speed": 5.0, "step": None}),
    "huge": lambda: say({"type": "command", "target_speed": 10**400}),
    "bool": lambda: say({"type": "command", "target_speed": True}),
    "deep": lambda: os.write(1, b'{"type": "command", "trajectory": ' + b"[" * 50_000 + b"\n"),
    "compute": lambda: say({"type": "command", "target_speed": 5.0, "compute": float("nan")}),
    "crowded": lambda: say({"type": "command", "trajectory": [[0, 1, 2]] * 10_001}),
    "flood": lambda: [os.write(1, bytes(65536)) for _ in range(16384)],
    "ahead": ahead,
    "close": lambda: [os.close(1), time.sleep(50)],  # type: ignore[func-returns-value]
}
HELLOS: dict[str, dict[str, object]] = {
    "version": {"version": 1},
    "name": {"version": 1, "name": "\x1b[2J" * 100_000},
    "format": {"format": "\x1b[2J" * 100_000},
    "rate": {"rate": 7},
    "tiny": {"rate": 5e-324},
    "huge rate": {"rate": 10**400},
    "nan rate": {"rate": float("nan")},
}

runs, asked = 0, 0
for line in sys.stdin:
    content = json.loads(line)
    if content["type"] == "hello":
        if fault == "mute":
            time.sleep(50)
        say({"type": "hello", "version": 2, "name": "faulty", "rate": 20} | HELLOS.get(fault, {}))
    elif content["type"] == "reset":
        runs, asked = runs + 1, 0
        if fault == "unready":
            sys.exit(4)
        say({"type": "ready"})
    elif content["type"] == "observe":
        asked += 1
        if (runs, asked) == (scenario, decision) and fault in FAULTS:
            os.write(2, f"warning: about to fail\nlast words of {fault}\n".encode())
            FAULTS[fault]()
            if fault not in ("late", "twice"):
                continue
        say({"type": "command", "target_speed": 5.0})
    else:
        break
