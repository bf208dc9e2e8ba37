"""Small OpenDRIVE files that would cost much are read, or refused in one sentence, within a gigabyte and some seconds."""

import math
import re
from pathlib import Path

from pytest_rvads.geometry.control import JunctionControl
from tools.crossings import Layout, opendrive

from ..bounded import answers

TEXT = opendrive(Layout(4, JunctionControl.LIGHTS))


def scaled(factor: float) -> str:
    """Return the map in another unit of length."""
    lengths = r'\b(length|s|x|y|a|sOffset)="([-0-9.e]+)"'
    return re.sub(lengths, lambda match: f'{match[1]}="{float(match[2]) * factor!r}"', TEXT)


def crosswalk(id: str, corners: int) -> str:
    angles = [math.tau * k / corners for k in range(corners)]
    outline = "".join(f'<cornerLocal u="{2 * math.cos(a)!r}" v="{6 * math.sin(a)!r}"/>' for a in angles)
    return f'<object type="crosswalk" id="{id}" s="5" t="0" hdg="0"><outlines><outline>{outline}</outline></outlines></object>'


def light(id: int) -> str:
    return f'<signal id="p{id}" type="1000002" dynamic="yes" s="5" t="0" orientation="+"/>'


def curves(count: int) -> str:
    shape = '<paramPoly3 aU="0" bU="1" cU="0" dU="0" aV="0" bV="0" cV="0" dV="0" pRange="arcLength"/>'
    return "".join(f'<geometry s="{k / 100}" x="0" y="-15" hdg="0" length="99999">{shape}</geometry>' for k in range(count))


def test_opendrive(tmp_path: Path) -> None:
    geometry = re.search("<geometry.*?</geometry>", TEXT, re.DOTALL)
    signal = re.search("<signal .*?</signal>", TEXT, re.DOTALL)
    assert geometry
    assert signal
    speeds = "".join(f'<type s="{k / 1e4}" type="town"><speed max="10"/></type>' for k in range(15_000))
    signals = "".join(signal[0].replace(' id="', f' id="x{k}', 1) for k in range(3000))
    walked = "".join(crosswalk(f"c{k}", 4) for k in range(40))
    lights = "".join(map(light, range(600)))
    texts = {
        "millimetres.xodr": (scaled(1000.0), "m long, expected at most 1,000 m; check the unit of length"),
        "times_200.xodr": (scaled(200.0), "m long, expected at most 1,000 m; check the unit of length"),
        "speeds.xodr": (TEXT.replace("</planView>", f"</planView>{speeds}", 1), "4 arms"),
        "signals.xodr": (TEXT.replace(signal[0], signals, 1), "4 arms"),
        "corners.xodr": (TEXT.replace("<objects>", f"<objects>{crosswalk('c', 10_000)}", 1), "4 arms"),
        "lights.xodr": (
            TEXT.replace("<objects>", f"<objects>{walked}", 1).replace("<signals>", f"<signals>{lights}", 1),
            "too many crosswalks and lights for pedestrians",
        ),
        "crosswalks.xodr": (
            TEXT.replace("<objects>", f"<objects>{''.join(crosswalk(f'c{k}', 4) for k in range(100))}", 1),
            "more than 50 crosswalks lie over arm 0 of junction '1'",
        ),
        "curves.xodr": (TEXT.replace(geometry[0], curves(1000), 1), "its lane centre lines would take"),
    }
    for name, (text, _) in texts.items():
        (tmp_path / name).write_text(text)
    found = answers([tmp_path / name for name in texts])
    assert {name: words for name, (_, words) in texts.items() if words not in found[name]} == {}
