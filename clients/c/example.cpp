// Stops at the line, lets those go first who came first or from the right, waits until the junction is free, and goes.
#include "rvads.h"    // g++ -O2 -o stack example.cpp
#include <set>

int main() {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    double since = -1.0, stood = -1.0;
    std::set<uint32_t> first;
    if (!rvads_open(&link, "example", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        const rvads_vehicle &me = seen.me;
        const rvads_scenario &scenario = link.scenario;
        if (link.fresh) since = stood = -1.0, first.clear();
        if (me.zone != RVADS_APPROACH && since < 0) since = seen.time;
        bool clear = true, due = false, tie = since >= 0 && seen.time - since <= 0.5;  // at about the same time
        std::set<uint32_t> ahead;
        for (uint32_t k = 0; k < seen.others_count; ++k) {
            const rvads_vehicle &other = seen.others[k];
            clear = clear && other.zone != RVADS_JUNCTION;
            due |= other.zone <= RVADS_ENTRANCE && scenario.opposite[other.entrance][me.entrance] &&
                   other.turn != RVADS_LEFT && -other.station < 10 + 5 * other.speed;
            bool right = tie && scenario.right_of[other.entrance][me.entrance];
            if (other.zone == RVADS_ENTRANCE && (me.zone == RVADS_APPROACH || right || first.count(other.id))) ahead.insert(other.id);
        }
        first = ahead;
        if (me.zone == RVADS_ENTRANCE && me.speed < 0.05 && stood < 0) stood = seen.time;
        bool green = seen.lights[me.entrance] == RVADS_GREEN, turns = me.turn == RVADS_LEFT;
        bool may = clear && (scenario.control == RVADS_LIGHTS ? green && !(turns && due)
                                                              : stood >= 0 && seen.time - stood > 0.5 && first.empty());
        double line = scenario.line - 0.5 - me.station;
        bool waits = me.zone <= RVADS_ENTRANCE && !may;
        rvads_target_speed(&command, waits ? rvads_stopping_speed(line, 2.0) : scenario.speed_limit);
        rvads_answer(&link, &command);
    }
}
