"""A stack that drives well and clings to life: ``clinging.py HOW TAG``; what it starts has the tag on its command line, too.

Whoever starts it may be killed before it is ended: no process of it lives longer than `LIFE`.
"""

import fcntl
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable

how, tag = sys.argv[1:3]
LIFE = 50
"""Longest life of a process [s]."""
END = time.monotonic() + LIFE
SLEEP = [sys.executable, "-I", "-S", "-c", f"import time; time.sleep({LIFE})", tag]
STUBBORN = [*SLEEP[:4], f"import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep({LIFE})", tag]


def say(content: dict[str, object]) -> None:
    os.write(1, json.dumps(content).encode() + b"\n")


def start(command: list[str], **more: object) -> None:
    silent = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.Popen(command, start_new_session=True, **{**silent, **more})  # type: ignore[call-overload]


def daemon(command: list[str], **more: object) -> None:
    """Start it from a process that ends, so that it has no parent here."""
    if (child := os.fork()) == 0:
        start(command, **more)
        os._exit(0)
    os.waitpid(child, 0)


def hop() -> None:
    """Be another process every moment, in a group that nobody else is in; what it locks stays locked as long as it lives."""
    if os.fork() == 0:
        os.setsid()
        fcntl.flock(os.open(tag, os.O_CREAT | os.O_RDWR), fcntl.LOCK_EX)
        while time.monotonic() < END and os.fork() == 0:
            pass
        os._exit(0)


def note_the_end() -> None:
    def end(*_: object) -> None:
        with open(tag, "w", encoding="utf-8") as file:
            file.write("SIGTERM")
        os._exit(0)

    signal.signal(signal.SIGTERM, end)


def several(command: list[str]) -> None:
    for _ in range(4):
        start(command)


BEGIN: dict[str, Callable[[], object]] = {
    "leaves sessions": lambda: several(SLEEP),
    "leaves stubborn sessions": lambda: several(STUBBORN),
    "leaves a daemon": lambda: daemon(SLEEP),
    "leaves a daemon that holds the pipes": lambda: daemon(STUBBORN, stdout=None, stderr=None),
    "leaves a child without environment": lambda: start(STUBBORN, env={}),
    "leaves who is always another": hop,
    "ignores bye": lambda: None,
    "is stopped": lambda: None,
    "ignores SIGTERM": lambda: signal.signal(signal.SIGTERM, signal.SIG_IGN),
    "ends by SIGTERM": note_the_end,
    "hides": lambda: daemon(SLEEP, stdout=None, env={}),
}
BEGIN[how]()
for line in sys.stdin:
    content = json.loads(line)
    if content["type"] == "hello":
        say({"type": "hello", "version": 2})
    elif content["type"] == "reset":
        say({"type": "ready"})
    elif content["type"] == "observe":
        say({"type": "command", "step": content["step"], "target_speed": 5.0})
    else:
        break
if how == "is stopped":
    stopped = os.getpid()
    if os.fork() == 0:
        time.sleep(LIFE)
        if os.getppid() == stopped:
            os.kill(stopped, signal.SIGKILL)
        os._exit(0)
    os.kill(stopped, signal.SIGSTOP)
if not how.startswith("leaves"):
    time.sleep(LIFE)
