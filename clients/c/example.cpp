// Stops at the line, waits until nobody is in the junction, and goes.    g++ -O2 -o stack example.cpp
#include "rvads.h"

int main() {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    double stood = -1.0;
    if (!rvads_open(&link, "example", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        if (link.fresh) stood = -1.0;
        const rvads_vehicle &me = seen.me;
        bool waiting = me.zone <= RVADS_ENTRANCE;
        if (waiting && me.zone == RVADS_ENTRANCE && me.speed < 0.05 && stood < 0) stood = seen.time;
        bool lights = link.scenario.control == RVADS_LIGHTS;
        bool may = lights ? seen.lights[me.entrance] == RVADS_GREEN : stood >= 0 && seen.time - stood > 0.5;
        for (uint32_t k = 0; k < seen.others_count; ++k) {
            const rvads_vehicle &other = seen.others[k];
            bool before = other.zone == RVADS_ENTRANCE && (lights ? other.turn != RVADS_LEFT && me.turn == RVADS_LEFT
                                                                  : other.entrance < me.entrance);
            may = may && other.zone != RVADS_JUNCTION && !before;
        }
        double line = link.scenario.line - 0.5 - me.station;
        rvads_target_speed(&command, waiting && !may ? rvads_stopping_speed(line, 2.0) : link.scenario.speed_limit);
        rvads_answer(&link, &command);
    }
}
