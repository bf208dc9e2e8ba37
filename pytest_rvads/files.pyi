# The public names, each written once: type checkers read this file, and so does `files.py`.

__all__: list[str]

from pytest_rvads.logic.rules.book import load_rules as load_rules
from pytest_rvads.runs.readers import read_recorded as read_recorded, read_runs as read_runs
from pytest_rvads.runs.runfile import load_recording as load_recording, load_run as load_run
from pytest_rvads.runs.runfile import save_recording as save_recording, save_run as save_run
from pytest_rvads.satellites.openscenario.run_export import export_run as export_run
from pytest_rvads.satellites.openscenario.scenario_xosc import load_scenario as load_scenario, save_scenario as save_scenario
from pytest_rvads.satellites.tracks.importing import read_tracks as read_tracks
