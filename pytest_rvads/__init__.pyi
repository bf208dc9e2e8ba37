# The public names, each written once: type checkers read this file, and so does `__init__.py`.

__all__: list[str]

from pytest_rvads import errors as errors, files as files, values as values
from pytest_rvads.drivers.follower import Follower as Follower
from pytest_rvads.drivers.reference import Reference as Reference
from pytest_rvads.drivers.traffic import RollingStop as RollingStop
from pytest_rvads.satellites.lgsvl import LgsvlLike as LgsvlLike
from pytest_rvads.drivers.traffic import Replay as Replay
from pytest_rvads.drivers.traffic import traffic as traffic
from pytest_rvads.satellites.campaigns.campaign import campaign as campaign
from pytest_rvads.session.collection.marks import known as known, recorded as recorded, scenario as scenario
from pytest_rvads.satellites.starts.critical_mark import critical as critical
from pytest_rvads.session.collection.searching import falsify as falsify
from pytest_rvads.support.errors import RuleViolation as RuleViolation
from pytest_rvads.logic.check import check as check
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor as RuleMonitor
from pytest_rvads.logic.rules.book import predicate as predicate, rule as rule
from pytest_rvads.logic.rules.rule import Rule as Rule
from pytest_rvads.logic.judging.verdicts import Status as Status, Verdict as Verdict
from pytest_rvads.geometry.finder import find as find
from pytest_rvads.geometry.junction import Junction as Junction
from pytest_rvads.simulators.loop import bullet as bullet, mujoco as mujoco
from pytest_rvads.satellites.sumo.sumo_simulator import Sumo as Sumo, sumo as sumo
from pytest_rvads.simulators.simulator import Simulator as Simulator, limits as limits, simulate as simulate, vmax as vmax
from pytest_rvads.scenarios.case import Case as Case, Fleet as Fleet
from pytest_rvads.scenarios.pedestrians import Pedestrian as Pedestrian
from pytest_rvads.scenarios.scenario import Scenario as Scenario
from pytest_rvads.scenarios.senses import Senses as Senses
from pytest_rvads.search import strategies as strategies
from pytest_rvads.satellites.relations.metamorphic import equivalent as equivalent
from pytest_rvads.satellites.relations.metamorphic import determinate as determinate, rational as rational
from pytest_rvads.logic.conduct.kpis import kpis as kpis
from pytest_rvads.runs.run import Run as Run
from pytest_rvads.runs.states import Agent as Agent, Colour as Colour, Kind as Kind, Zone as Zone
from pytest_rvads.drivers.interface import (
    Acceleration as Acceleration,
    Autopilot as Autopilot,
    Control as Control,
    Factory as Factory,
    Observation as Observation,
    TargetSpeed as TargetSpeed,
    TrafficSystem as TrafficSystem,
    Trajectory as Trajectory,
    Waypoint as Waypoint,
)
from pytest_rvads.logic.conduct.validate import validate as validate
from pytest_rvads.runs.states import Vehicle as Vehicle
from pytest_rvads.drivers.stacks.process import Process as Process

__version__: str
