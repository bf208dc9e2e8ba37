"""The functions that read and write files of runs, recordings, scenarios and rules."""

from pytest_rvads.logic.rules.book import load_rules
from pytest_rvads.runs.readers import read_recorded, read_runs
from pytest_rvads.runs.runfile import load_recording, load_run, save_recording, save_run
from pytest_rvads.satellites.openscenario.run_export import export_run
from pytest_rvads.satellites.openscenario.scenario_xosc import load_scenario, save_scenario
from pytest_rvads.satellites.tracks.importing import read_tracks

__all__ = [
    "export_run",
    "load_recording",
    "load_rules",
    "load_run",
    "load_scenario",
    "read_recorded",
    "read_runs",
    "read_tracks",
    "save_recording",
    "save_run",
    "save_scenario",
]
