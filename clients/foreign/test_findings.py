"""Findings in CARLA's agents: a test fails with the agents as they are; README.md quotes the change with which it passes."""

import carla_agents
import pytest

import pytest_rvads as rvads


class TestBasicAgent:
    @pytest.fixture
    def rvads_autopilot(self):
        return carla_agents.Basic

    @rvads.scenario("light4", scenarios="0200", subject=1, distances=40, speeds=8, rules=("red", "keep_clear"))
    def test_red_light_exactly_ahead_is_seen(self, monitor, rule):
        monitor.check(rule)

    @rvads.scenario("lanes4", scenarios="20_00_00_00", subject=0, distances=40, speeds=8, rules="progress")
    def test_light_of_the_next_lane_is_not_obeyed(self, monitor, rule):
        monitor.check(rule)

    @rvads.scenario("light4", scenarios="3020", subject=0, distances=40, speeds=8, rules="left_yields")
    def test_left_turn_lets_oncoming_traffic_pass(self, monitor, rule):
        monitor.check(rule)


class TestBehaviorAgent:
    @pytest.fixture
    def rvads_autopilot(self):
        return carla_agents.Normal

    @rvads.scenario("light4", scenarios="0200", subject=1, distances=40, speeds=10, rules=("red", "keep_clear"))
    def test_red_light_is_seen_in_time(self, monitor, rule):
        monitor.check(rule)

    @rvads.scenario("light4", scenarios="0200", subject=1, distances=40, speeds=8, rules=("keep_lane", "on_route"))
    def test_start_after_a_red_light_keeps_the_lane(self, monitor, rule):
        monitor.check(rule)
