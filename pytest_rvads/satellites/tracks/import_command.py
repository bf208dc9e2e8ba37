"""``rvads import``: recorded traffic of elsewhere, matched to a junction and kept."""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pytest_rvads.cli.common import Subparsers, progress, say, warn
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.turn_words import turn_word
from pytest_rvads.satellites.tracks.intake_options import add_intake, intake_of

if TYPE_CHECKING:
    from pytest_rvads.runs.recording import Recording

__all__ = ["declare"]

_SHOWN = 3
"""So many reasons for leaving vehicles out are shown, and vehicles with damaged rows."""


def declare(commands: Subparsers) -> None:
    """Add the command of this module."""
    parser = commands.add_parser(
        "import",
        help="bring in recorded traffic: CSV, SUMO, CARLA, OSI, ROS bags, OpenSCENARIO",
        description="Matches every vehicle of a log to a way through a junction and keeps what is found for `rvads check`.",
    )
    parser.add_argument("tracks", metavar="TRACKS", help="file of tracks, or the folder of a bag")
    parser.add_argument("--map", metavar="FILE", help="OpenDRIVE file of the junction, in whose coordinates the tracks are")
    parser.add_argument(
        "--junction",
        metavar="ID",
        help="id in --map, built-in name, type or place, or all of --map; a log that names its map needs none",
    )
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help="file to write (.npz); a folder for --junction all")
    parser.add_argument(
        "--format",
        metavar="NAME",
        help="csv, fcd or another format (default: by the name of the file); a wrong name lists all",
    )
    parser.add_argument("--columns", metavar="FIELD=COLUMN[:UNIT],...", help="as in time=t:ms,id=track,x=X,y=Y,heading=yaw:deg")
    add_intake(parser)
    parser.add_argument("--lights", metavar="FILE", help="CSV with time, signal or entrance, colour; or <tlsState> of SUMO")
    parser.add_argument("--label", metavar="NAME", help="begins the names of its runs (default: the name of the file)")
    parser.add_argument("--strict", action="store_true", help="a bad row is an error; else it costs its vehicle")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("-v", "--verbose", action="store_true", help="list every vehicle that is left out")
    parser.set_defaults(command=_import)


def _import(options: argparse.Namespace) -> int:
    from pytest_rvads.runs.recordingfile import save_recording
    from pytest_rvads.satellites.tracks.importing import (
        check_one,
        junctions_of,
        label_of,
        light_log,
        passed,
        unlit,
    )
    from pytest_rvads.satellites.tracks.logformats import read_log
    from pytest_rvads.satellites.tracks.table import parse_columns

    several = options.junction == "all"
    if (options.format or Path(options.tracks).suffix.lower().removeprefix(".")) != "xosc":  # which names its map
        _check_junction(options)
    columns = parse_columns(options.columns) if options.columns else None
    log, usual = read_log(options.tracks, format=options.format, columns=columns, strict=options.strict, watch=_watch())
    for sentence in log.again[:_SHOWN]:
        warn(f"warning: {sentence}")
    if len(log.again) > _SHOWN:
        warn(f"warning: {len(log.again)} ids are used again by other vehicles, the first {_SHOWN} are told above")
    junctions = junctions_of(log, options.junction, options.map)
    intake = intake_of(options, usual)
    shown = light_log(log, options.lights)
    watch = partial(progress, what="junctions") if several else None
    recordings = passed(log, junctions, intake, shown, label_of(log, options.label), by_junction=several, watch=watch)
    if not several:
        check_one(log, recordings)
    found = [(Path(options.output, f"{r.junction.name}.npz") if several else Path(options.output), r) for r in recordings]
    if shown and not any(recording.lights for recording in recordings):
        if options.lights:
            raise RunError(unlit(shown, recordings[0].junction))
        warn(f"warning: {unlit(shown, recordings[0].junction)}")
    for path, recording in found:
        save_recording(recording, path)
    told = [_told(path, recording, stated=options.position_accuracy is not None) for path, recording in found]
    if options.json:
        print(json.dumps(told if several else told[0]))
        return 0
    for one in told:
        say("\n  ".join(_lines(one, verbose=options.verbose)))
    return 0


def _check_junction(options: argparse.Namespace) -> None:
    """Tell what is wrong with a junction before anything long is read."""
    from pytest_rvads.junctions.finder import find

    if options.junction is None:
        raise RunError("name the junction that the tracks are at: --junction ID, with --map FILE where it is not built in")
    if options.junction != "all":
        find(options.junction, options.map)
    elif options.map is None:
        raise RunError("--junction all takes the junctions of a map: give --map FILE")


def _watch() -> Any:
    """Return what draws a bar while a file is read, in parts of a hundred."""
    drawn = [0]

    def watch(done: int, total: int) -> None:
        part = 100 * done // max(total, 1)
        while drawn[0] < part:
            drawn[0] += 1
            progress(drawn[0], 100, "% read")

    return watch


def _told(path: Path, recording: Recording, *, stated: bool) -> dict[str, Any]:
    """Return what came in, as JSON has it."""
    junction, tracks = recording.junction, recording.tracks
    ways = Counter(track.agent.way.key for track in tracks)
    arms = {key: (junction.vehicle_at(key[0]).removeprefix("a"), f"{junction.exits[key[1]].arm}") for key in ways}
    worst = max(tracks, key=lambda track: track.offset)
    begin, end = min(track.times[0] for track in tracks), max(track.times[-1] for track in tracks)
    step = sorted(float(t.times[-1] - t.times[0]) / (len(t.times) - 1) for t in tracks)[len(tracks) // 2]
    return {
        "file": str(path),
        "recording": recording.label,
        "junction": junction.name,
        "vehicles": len(tracks),
        "movements": {
            f"{arms[key][0]} to {arms[key][1]}, {turn_word(junction, junction.movements[key])}": count
            for key, count in sorted(ways.items())
        },
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
        "lights": sorted(junction.vehicle_at(entrance).removeprefix("a") for entrance in recording.lights),
        "periods": len(recording),
        "left_out": dict(recording.left_out),
    }


def _lines(told: dict[str, Any], *, verbose: bool) -> list[str]:
    """Return what came in, in words, line by line."""
    offset, accuracy, clock, out = told["offset"], told["accuracy"], told["clock"], told["left_out"]
    known = "stated" if accuracy["stated"] else "estimated"
    vehicles, periods = _counted(told["vehicles"], "vehicle"), _counted(told["periods"], "busy period")
    lines = [
        f"{told['file']}: {vehicles} at {told['junction']}, {periods}",
        f"from {clock['begin']:.13g} to {clock['end']:.13g} s, "
        f"a sample every {clock['step']:g} s, now every {clock['resampled']:g} s",
        "; ".join(f"{count} from {way}" for way, count in told["movements"].items()),
        f"beside their ways by {offset['mean']:.2f} m on average, at most {offset['worst']:.2f} m ({offset['vehicle']})",
        f"positions are {'exact' if not accuracy['position'] else format(accuracy['position'], '.3f') + ' m accurate'} ({known})",
    ]
    if accuracy["speed"]:
        lines.append(f"speeds are {accuracy['speed']:.2f} m/s accurate")
    if told["lights"]:
        lines.append(f"lights at entrances {', '.join(told['lights'])}")
    reasons = Counter(out.values()).most_common()
    if out:
        lines.append(f"left out: {len(out)}")
        lines += [f"  {count}: {why}" for why, count in reasons[: None if verbose else _SHOWN]]
        if len(reasons) > _SHOWN and not verbose:
            lines.append(f"  and {sum(count for _, count in reasons[_SHOWN:])} for other reasons: -v lists them")
    if verbose:
        lines += [f"  {name}: {why}" for name, why in out.items()]
    return lines


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"
