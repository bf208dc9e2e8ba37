# The public names, each written once: type checkers read this file, and so does `values.py`.

__all__: list[str]

from pytest_rvads.geometry.control import Sign as Sign
from pytest_rvads.geometry.turns import Turn as Turn
from pytest_rvads.geometry.ways import Entrance as Entrance, Exit as Exit, Movement as Movement
from pytest_rvads.logic.conduct.validate import Finding as Finding
from pytest_rvads.logic.rules.book import RuleBook as RuleBook
from pytest_rvads.logic.rules.vocabulary import Word as Word
from pytest_rvads.runs.itineraries import Itinerary as Itinerary
from pytest_rvads.runs.measured import Kpis as Kpis
from pytest_rvads.runs.recording import Recording as Recording
from pytest_rvads.runs.run import Collision as Collision, Facts as Facts, Fault as Fault
from pytest_rvads.runs.states import VehicleState as VehicleState
from pytest_rvads.satellites.campaigns.resultsfile import Results as Results
from pytest_rvads.satellites.live.instant import Decided as Decided, Seen as Seen
