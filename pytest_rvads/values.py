"""The classes of values that are parts of runs, junctions and rules, or that functions take or return.

A test reads such values without their classes. Annotations, and code that makes a `Run`, need the classes.
"""

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Movement
from pytest_rvads.logic.conduct.validate import Finding
from pytest_rvads.logic.rules.book import RuleBook
from pytest_rvads.logic.rules.vocabulary import Word
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.measured import Kpis
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.run import Collision, Facts, Fault
from pytest_rvads.runs.states import VehicleState
from pytest_rvads.satellites.campaigns.resultsfile import Results
from pytest_rvads.satellites.live.instant import Decided, Seen

__all__ = [
    "Collision",
    "Decided",
    "Entrance",
    "Exit",
    "Facts",
    "Fault",
    "Finding",
    "Itinerary",
    "Kpis",
    "Movement",
    "Recording",
    "Results",
    "RuleBook",
    "Seen",
    "Sign",
    "Turn",
    "VehicleState",
    "Word",
]
