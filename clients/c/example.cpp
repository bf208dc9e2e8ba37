// Stops at the line, lets those go first who came first or from the right, waits until the junction is free, and goes.
#include "rvads.h"    // g++ -O2 -o stack example.cpp

int main() {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    double since = -1.0, stood = -1.0;
    bool first[RVADS_WAYS] = {};
    if (!rvads_open(&link, "example", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        const rvads_vehicle &me = seen.me;
        const rvads_scenario &scenario = link.scenario;
        bool fresh = link.fresh, clear = true, due = false, queue = false, standing[RVADS_WAYS] = {};
        for (uint32_t k = 0; k < seen.others_count; ++k) {
            const rvads_vehicle &other = seen.others[k];
            clear = clear && other.zone != RVADS_JUNCTION;
            standing[other.entrance] |= other.zone == RVADS_ENTRANCE;
            due |= other.zone <= RVADS_ENTRANCE && scenario.opposite[other.entrance][me.entrance] &&
                   other.turn != RVADS_LEFT && -other.station < 10 + 5 * other.speed;
        }
        if (fresh) since = stood = -1.0;
        if (me.zone != RVADS_APPROACH && since < 0) since = seen.time;
        for (uint32_t e = 0; e < seen.ways; ++e) {
            bool tie = since >= 0 && seen.time - since <= 0.5 && scenario.right_of[e][me.entrance];
            first[e] = standing[e] && (me.zone == RVADS_APPROACH || tie || (!fresh && first[e]));
            queue |= first[e];
        }
        if (me.zone == RVADS_ENTRANCE && me.speed < 0.05 && stood < 0) stood = seen.time;
        bool green = seen.lights[me.entrance] == RVADS_GREEN, turns = me.turn == RVADS_LEFT;
        bool may = clear && (scenario.control == RVADS_LIGHTS ? green && !(turns && due)
                                                              : stood >= 0 && seen.time - stood > 0.5 && !queue);
        double line = scenario.line - 0.5 - me.station;
        bool waits = me.zone <= RVADS_ENTRANCE && !may;
        rvads_target_speed(&command, waits ? rvads_stopping_speed(line, 2.0) : scenario.speed_limit);
        rvads_answer(&link, &command);
    }
}
