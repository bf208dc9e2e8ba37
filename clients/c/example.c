/* Stops at the line, waits until the junction is free, and goes. */
#include "rvads.h" /* gcc -std=c99 -O2 -o stack example.c */

int main(void) {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    double stood = -1.0; /* since when it stands at the line */
    if (!rvads_open(&link, "example", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        const rvads_scenario *scenario = &link.scenario;
        const rvads_vehicle *me = &seen.me;
        double line = scenario->line - 0.5 - me->station;
        int may;
        if (link.fresh) stood = -1.0;
        if (me->zone == RVADS_ENTRANCE && me->speed < 0.05 && stood < 0) stood = seen.time;
        may = scenario->control == RVADS_LIGHTS ? seen.lights[me->entrance] == RVADS_GREEN : stood >= 0 && seen.time - stood > 0.5;
        for (uint32_t k = 0; k < seen.others_count; ++k) may = may && seen.others[k].zone != RVADS_JUNCTION;
        may = may || me->zone > RVADS_ENTRANCE;
        rvads_target_speed(&command, may ? scenario->speed_limit : rvads_stopping_speed(line, 2.0));
        rvads_answer(&link, &command);
    }
    return 0;
}
