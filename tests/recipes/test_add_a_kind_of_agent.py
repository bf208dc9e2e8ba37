"""CONTRIBUTING.md, "Add a kind of agent": done in a copy of the package, where one more member of `Kind` is all that it takes."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.samples import kind_of

from .changes import CHANGES, ROOT, copied, edit

TRIAL = """
import json
import struct
from dataclasses import replace

import pytest_rvads as rvads
from pytest_rvads.report.scene import picture
from pytest_rvads.drivers.stacks import frames, messages
from pytest_rvads.runs.states import Kind

class Spy(rvads.Reference):
    def control(self, seen):
        Spy.seen = seen
        return super().control(seen)

run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2000", duration=0.05), Spy))
found = {}
for kind in Kind:
    one = replace(run, agents=(replace(run.agents[0], kind=kind, size=(1.25, 0.75)),))
    rvads.files.save_run(one, "one.npz")
    kept = rvads.files.load_run("one.npz")
    seen = Spy.seen._replace(me=Spy.seen.me._replace(kind=kind))
    told = []
    for talk in (messages.Json(), frames.Binary()):
        talk.begin(messages.reset(seen, 0.05))
        told.append(talk.observe(seen, 1))
    found[kind.value] = {
        "hash": one.hash,
        "kept": kept == one and kept.agents[0].kind is kind,
        "json": json.loads(told[0])["me"]["kind"],
        "frame": struct.unpack_from("<I", told[1], frames.HEADER.size + frames._SEEN.size + 4)[0],
        "drawn": 'width="1.25" height="0.75"' in picture(one, 0, "title"),
    }
print(json.dumps(found))
"""


@pytest.mark.extended
def test_a_member_is_kept_told_and_drawn(tmp_path: Path) -> None:
    copied(tmp_path)
    edit(tmp_path, CHANGES["a kind of agent"].code)
    command = [sys.executable, "-c", TRIAL]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert list(found) == [*(kind.value for kind in Kind), "tram"]
    assert len({one.pop("hash") for one in found.values()}) == len(found)
    for number, (kind, one) in enumerate(found.items()):
        assert one == {"kept": True, "json": kind, "frame": number, "drawn": True}


def test_the_enumeration_of_c_has_the_order_of_the_kinds() -> None:
    """A frame of the protocol holds the number of a kind."""
    header = (ROOT / "clients" / "c" / "rvads.h").read_text(encoding="utf-8")
    (names,) = re.findall(r"enum \{ ([\w, ]+) \}; +/\* kind \*/", header)
    assert [name.removeprefix("RVADS_").lower() for name in names.split(", ")] == [kind.value for kind in Kind]


@pytest.mark.parametrize(("kind", "word"), [(kind, word) for kind in Kind for word in kind.words])
def test_every_word_of_a_kind_names_that_kind(kind: Kind, word: str) -> None:
    """A word that contains a word of an earlier kind, as "motorbike" contains "bike", would name the earlier kind."""
    assert kind_of(word.title()) is kind
