"""The command ``rvads import``: matches a log of traffic to a junction and writes a recording.

`add_intake` and `intake_of` hold the options that `rvads import` shares with `rvads check --follow`.
"""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli.common import MAP_FORMATS, Subparsers, progress, say, share, warn
from pytest_rvads.support.errors import RunError

if TYPE_CHECKING:
    from pytest_rvads.geometry.ways import Key
    from pytest_rvads.runs.recording import Recording
    from pytest_rvads.satellites.tracks.correcting import Misalignment
    from pytest_rvads.satellites.tracks.importing import Intake
    from pytest_rvads.satellites.tracks.logformats import Point
    from pytest_rvads.satellites.tracks.samples import Log


INTAKE = ("point", "size", "offset", "accuracy", "speed_limit")
"""Names of the parsed options of `add_intake`."""
_MOST_SHOWN = 3
"""Largest number of reasons for omitted vehicles that are shown, and largest number of reused ids."""


def declare(commands: Subparsers) -> None:
    """Add the command ``rvads import`` to the parser."""
    parser = commands.add_parser(
        "import",
        help="import recorded traffic: CSV, SUMO, CARLA, OSI, ROS bags, CommonRoad, OpenSCENARIO",
        description="Matches every vehicle of a log to a way through a junction and writes the recording for `rvads check`.",
    )
    parser.add_argument("tracks", metavar="TRACKS", help="file of tracks, or the folder of a bag")
    share(parser, "map", help=f"map file ({MAP_FORMATS}) of the junction; tracks have the coordinates of this map")
    share(
        parser,
        "junction",
        help="id in --map, built-in name, type or place; all for every junction of --map; not needed if the log names its map",
    )
    share(parser, "output", required=True, help="file to write (.npz); a folder for --junction all")
    parser.add_argument(
        "--format",
        metavar="NAME",
        help="csv, fcd or another format (default: by the suffix of the file); a wrong name lists all formats",
    )
    parser.add_argument(
        "--columns", metavar="FIELD=COLUMN[:UNIT],...", help="column per field, as in time=t:ms,id=track,x=X,y=Y,heading=yaw:deg"
    )
    parser.add_argument(
        "--classes", metavar="CLASS=KIND,...", help="kind of road user per class of the log, as in 1=cyclist,lkw=truck"
    )
    add_intake(parser)
    parser.add_argument(
        "--align", action="store_true", help="shift and turn all tracks so that they lie on the lanes of the map on average"
    )
    parser.add_argument(
        "--lights", metavar="FILE", help="file of lights: CSV with time, signal or entrance, colour; or <tlsState> of SUMO"
    )
    share(parser, "strict", help="stop at a bad row; otherwise the vehicle of the row is left out")
    share(parser, "json", help="print one JSON object, which has the reason of every omitted vehicle")
    parser.set_defaults(command=_import)


def _import(options: argparse.Namespace) -> int:
    from pytest_rvads.runs.runfile import save_recording
    from pytest_rvads.satellites.tracks.importing import (
        check_single_junction,
        junctions_of,
        label_of,
        lights_elsewhere,
        on_map,
        recordings_at,
    )
    from pytest_rvads.satellites.tracks.lightlog import read_lights
    from pytest_rvads.satellites.tracks.logformats import format_of, read_log
    from pytest_rvads.satellites.tracks.table import parse_pairs

    all_junctions = options.junction == "all"
    if not format_of(Path(options.tracks), options.format).with_map:
        _check_junction(options)
    columns = parse_pairs(options.columns, "--columns", "time=t:ms,id=track,x=X,y=Y,heading=yaw:deg")
    classes = parse_pairs(options.classes, "--classes", "1=cyclist,lkw=truck")
    settings = {"format": options.format, "columns": columns, "classes": classes, "strict": options.strict}
    log, usual_point = read_log(options.tracks, **settings, watch=_watch())
    log = on_map(log, options.map)
    for sentence in (*log.notes, *log.reused_ids[:_MOST_SHOWN]):
        warn(f"warning: {sentence}")
    if len(log.reused_ids) > _MOST_SHOWN:
        warn(f"warning: several vehicles share each of {len(log.reused_ids)} ids, the first {_MOST_SHOWN} are listed above")
    junctions = junctions_of(log, options.junction, options.map)
    intake = intake_of(options, usual_point)
    lights = log.lights if options.lights is None else read_lights(Path(options.lights))
    watch = partial(progress, what="junctions") if all_junctions else None
    recorded = partial(
        recordings_at,
        junctions=junctions,
        intake=intake,
        recorded_lights=lights,
        label=label_of(log),
        by_junction=all_junctions,
        watch=watch,
    )
    recordings, misalignment = _aligned(log, recorded, intake, align=options.align)
    if not all_junctions:
        check_single_junction(log, recordings)
    files = [(Path(options.output, f"{r.junction.name}.npz") if all_junctions else Path(options.output), r) for r in recordings]
    if lights and not any(recording.lights for recording in recordings):
        if options.lights:
            raise RunError(lights_elsewhere(lights, recordings[0].junction))
        warn(f"warning: {lights_elsewhere(lights, recordings[0].junction)}")
    for path, recording in files:
        save_recording(recording, path)
        _warn_of_gaps(recording)
    correction = misalignment.as_json() | {"applied": options.align}
    summaries = [
        _recording_summary(path, recording, stated=intake.position_accuracy is not None) | {"misalignment": correction}
        for path, recording in files
    ]
    if options.json:
        print(json.dumps(summaries if all_junctions else summaries[0]))
        return 0
    for summary in summaries:
        say("\n  ".join(_summary_lines(summary)))
    return 0


def _warn_of_gaps(recording: Recording) -> None:
    """Warn of colours and sizes that a recording lacks."""
    from pytest_rvads.satellites.tracks.importing import unknown_lights

    unsized = sum(track.agent.size is None for track in recording.vehicles)
    if unsized:
        warn(
            f"warning: {recording.junction.name}: the log has no size of {_count_text(unsized, 'vehicle')}, so rules about "
            "bodies are NA: give length and width by --size"
        )
    since = unknown_lights(recording)
    if since:
        never = ", ".join(name for name, time in since.items() if time is None)
        late = (f"before {time:g} s at entrance {name}" for name, time in since.items() if time is not None)
        places = "; ".join([*([f"at entrances {never}"] if never else []), *late])
        warn(
            f"warning: {recording.junction.name}: no colours are recorded for lights of the map {places}: verdicts that depend "
            "on them are UNSURE or NA, give the colours by --lights"
        )


def _check_junction(options: argparse.Namespace) -> None:
    """Check the options ``--junction`` and ``--map``, so that a wrong option is an error before a long file is read."""
    from pytest_rvads.geometry.finder import find

    if options.junction is None:
        raise RunError("name the junction of the tracks: --junction ID, and --map FILE unless the junction is built in")
    if options.junction != "all":
        find(options.junction, options.map)
    elif options.map is None:
        raise RunError("--junction all means all junctions of a map: give --map FILE")


def _aligned(
    log: Log, recorded: Callable[[Log], list[Recording]], intake: Intake, *, align: bool
) -> tuple[list[Recording], Misalignment]:
    """Return the recordings of a log, and by how much the tracks lie beside the lanes; with `align`, the tracks are corrected."""
    from pytest_rvads.satellites.tracks.correcting import TOLERATED, misalignment_of

    recordings = recorded(log)
    misalignment = misalignment_of(recordings)
    if align:
        recordings = recorded(log.moved(*misalignment.similarity(intake.offset)))
        warn(f"the tracks were moved, because they {misalignment.in_words()}")
    elif misalignment.systematic > TOLERATED:
        warn(f"warning: the tracks {misalignment.in_words()}: --align moves them")
    return recordings, misalignment


def _watch() -> Any:
    """Return a function that draws a progress bar in percent while a file is read."""
    drawn_part = [0]

    def watch(done: int, total: int) -> None:
        part = 100 * done // max(total, 1)
        while drawn_part[0] < part:
            drawn_part[0] += 1
            progress(drawn_part[0], 100, "% read")

    return watch


def _recording_summary(path: Path, recording: Recording, *, stated: bool) -> dict[str, Any]:
    from pytest_rvads.geometry.crosswalks import Crossing
    from pytest_rvads.logic.telling.phrase import turns
    from pytest_rvads.satellites.tracks.importing import unknown_lights

    junction, tracks = recording.junction, recording.vehicles
    ways: Counter[tuple[Key, str]] = Counter()
    for agent in (track.agent for track in tracks):
        arms = dict.fromkeys(f"{junction.exits[exit].arm}" for exit in (agent.exit, *agent.other_exits))
        doubt = f": {agent.name} crashed before its way was decided" if agent.other_exits else ""
        entrance = junction.vehicle_at(agent.entrance).removeprefix("a")
        ways[agent.way.key, f"{entrance} to {' or '.join(arms)}, {turns(junction, agent)}{doubt}"] += 1
    worst = max(tracks, key=lambda track: track.offset)
    begin, end = min(track.times[0] for track in tracks), max(track.times[-1] for track in tracks)
    step = sorted(float(t.times[-1] - t.times[0]) / (len(t.times) - 1) for t in tracks)[len(tracks) // 2]
    return {
        "file": str(path),
        "recording": recording.label,
        "junction": junction.name,
        "vehicles": len(tracks),
        "pedestrians": len(recording.tracks) - len(tracks),
        "movements": {way: count for (_, way), count in sorted(ways.items())},
        "offset": {
            "mean": round(math.fsum(track.offset for track in tracks) / len(tracks), 4),
            "worst": round(worst.offset, 4),
            "vehicle": worst.agent.name,
        },
        "accuracy": {"position": recording.position_accuracy, "speed": recording.speed_accuracy, "stated": stated},
        "clock": {
            "begin": round(float(begin), 3),
            "end": round(float(end), 3),
            "step": round(step, 4),
            "resampled": recording.dt,
        },
        "lights": sorted(
            junction.vehicle_at(start).removeprefix("a") for start in recording.lights if start < len(junction.entrances)
        ),
        "unknown_lights": unknown_lights(recording),
        "walk_lights": sorted(
            {way.crosswalk for way, _, _ in junction.further if isinstance(way, Crossing) and way.entrance in recording.lights}
        ),
        "periods": len(recording),
        "left_out": dict(recording.left_out),
    }


def _summary_lines(summary: dict[str, Any]) -> list[str]:
    offset, accuracy, clock, left_out = summary["offset"], summary["accuracy"], summary["clock"], summary["left_out"]
    origin = "stated" if accuracy["stated"] else "estimated"
    exact = "positions are exact (stated)" if accuracy["stated"] else "positions are taken as exact, because no noise was found"
    vehicles, periods = _count_text(summary["vehicles"], "vehicle"), _count_text(summary["periods"], "busy period")
    if summary["pedestrians"]:
        vehicles += f" and {_count_text(summary['pedestrians'], 'pedestrian')}"
    lines = [
        f"{summary['file']}: {vehicles} at {summary['junction']}, {periods}",
        f"from {clock['begin']:.13g} to {clock['end']:.13g} s, "
        f"a sample every {clock['step']:g} s, now every {clock['resampled']:g} s",
        "; ".join(f"{count} from {way}" for way, count in summary["movements"].items()),
        f"distance from their ways {offset['mean']:.2f} m on average, at most {offset['worst']:.2f} m ({offset['vehicle']})",
        f"positions are {accuracy['position']:.3f} m accurate ({origin})" if accuracy["position"] else exact,
    ]
    if accuracy["speed"]:
        lines.append(f"speeds are {accuracy['speed']:.2f} m/s accurate")
    if summary["lights"]:
        lines.append(f"lights at entrances {', '.join(summary['lights'])}")
    if summary["walk_lights"]:
        lines.append(f"pedestrian lights at crosswalks {', '.join(map(str, summary['walk_lights']))}")
    reasons = Counter(left_out.values()).most_common()
    if left_out:
        lines.append(f"left out: {len(left_out)}")
        lines += [f"  {count}: {why}" for why, count in reasons[:_MOST_SHOWN]]
        if len(reasons) > _MOST_SHOWN:
            lines.append(f"  and {sum(count for _, count in reasons[_MOST_SHOWN:])} for other reasons: --json lists them")
    return lines


def _count_text(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def add_intake(parser: argparse._ActionsContainer) -> None:
    """Add the options for the settings of an import (`Intake`) to the parser of a command."""
    parser.add_argument("--point", metavar="POINT", help="recorded point of a vehicle: center (of its box), front or rear_axle")
    parser.add_argument("--size", metavar="L,W", help="length and width of vehicles without a size in the log [m]")
    parser.add_argument("--offset", metavar="X,Y", help="add this to every position [m]; write --offset=-5,2")
    parser.add_argument(
        "--accuracy", metavar="M[,M/S]", help="standard deviation of a coordinate [m] and of a speed [m/s] (default: estimated)"
    )
    parser.add_argument("--speed-limit", type=float, metavar="M/S", help="speed limit at the junction [m/s]")


def intake_of(options: argparse.Namespace, usual: Point) -> Intake:
    """Return the settings of an import from the options; `usual` is the recorded point of vehicles without ``--point``."""
    from pytest_rvads.satellites.tracks.importing import Intake

    size, offset = _numbers(options.size, "--size L,W"), _numbers(options.offset, "--offset=X,Y") or (0.0, 0.0)
    position, _, speed = (options.accuracy or "").partition(",")
    try:
        accuracy = float(position) if position else None, float(speed) if speed else None
    except ValueError:
        raise RunError(
            f"--accuracy takes a number of metres, or such a number and a speed [m/s], got {options.accuracy!r:.60}"
        ) from None
    return Intake(options.point or usual, size, offset, *accuracy, options.speed_limit)


def _numbers(text: str | None, option: str) -> tuple[float, float] | None:
    """Return the two numbers of an option; None if the option was not given."""
    if text is None:
        return None
    try:
        first, second = map(float, text.split(","))
    except ValueError:
        raise RunError(f"{option} takes two numbers in metres, got {text!r:.60}") from None
    return first, second
