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


FAULTS: dict[str, Callable[[], object]] = {
    "crash": lambda: sys.exit("cannot open the map"),
    "segfault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
    "hang": lambda: time.sleep(600),
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
    "close": lambda: [os.close(1), time.sleep(60)],  # type: ignore[func-returns-value]
}

runs, asked = 0, 0
for line in sys.stdin:
    content = json.loads(line)
    if content["type"] == "hello":
        if fault == "mute":
            time.sleep(60)
        say({"type": "hello", "version": 1 if fault == "version" else 2, "name": "faulty", "rate": 7 if fault == "rate" else 20})
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
