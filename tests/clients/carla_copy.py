"""A copy of CARLA's package ``agents`` that can be imported.

In the folder ``../shared`` four files of that package have damaged indents and quotation marks, and do not compile. The copy is
mended as the text around each place needs. No line that decides anything is changed.
"""

import re
import shutil
from collections.abc import Callable
from pathlib import Path


def _tailgating(text: str) -> str:
    """Indent the body of ``_tailgating``, which stands at the level of the class."""
    begin, end = text.index("    left_turn = waypoint."), text.index("    def collision_and_car_avoid_manager")
    head, condition, rest = text[begin:end].partition(
        "    if behind_vehicle_state and self._speed < get_speed(behind_vehicle):\n"
    )
    body = re.sub(r"(?m)^(?=.)", " " * 4, head + condition) + re.sub(r"(?m)^(?=.)", " " * 8, rest)
    return text[:begin] + body + text[end:]


MENDED: dict[str, Callable[[str], str]] = {
    "navigation/basic_agent.py": lambda text: text.replace(
        'target speed in Km/h\n        ""\n', 'target speed in Km/h\n        """\n'
    ).replace("route_trace = self.", "end_waypoint = self._map.get_waypoint(end_location)\n        route_trace = self."),
    "navigation/behavior_agent.py": _tailgating,
    "navigation/global_route_planner.py": lambda text: text.replace("\n   EdgeDict =", "\n    EdgeDict =").replace(
        '\n         """\n', '\n        """\n'
    ),
    "tools/hints.py": lambda text: re.sub(r"(?m)^ {5}(?=# |Traffic)", "    ", text),
}


def carla_copy(source: Path, target: Path, *changes: tuple[str, str, str]) -> Path:
    """Copy the folder that holds ``agents``, mend the copy, and change it.

    Args:
        source: folder with the package ``agents``.
        target: folder of the copy, which must not exist.
        changes: per change the file within ``agents``, a text that the file has once, and the text in its place.

    Returns:
        The folder of the copy.
    """
    shutil.copytree(source, target, copy_function=shutil.copyfile)
    for file, mend in MENDED.items():
        path = target / "agents" / file
        path.write_text(mend(path.read_text(encoding="utf-8")), encoding="utf-8")
    for file, before, after in changes:
        path = target / "agents" / file
        text = path.read_text(encoding="utf-8")
        assert text.count(before) == 1, f"{file} has {before!r} {text.count(before)} times"
        path.write_text(text.replace(before, after), encoding="utf-8")
    return target
