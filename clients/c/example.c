/* Keeps its distance, stops at stop signs, red lights and for pedestrians, gives way, waits while somebody is in its way, and goes. */
#include "rvads.h" /* gcc -std=c99 -O2 -o stack example.c */

int main(void) {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    double stood = -1.0; /* since when it stands at the line */
    if (!rvads_open_with_pedestrians(&link, "example", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        const rvads_scenario *scenario = &link.scenario;
        const rvads_vehicle *me = &seen.me;
        uint32_t sign = scenario->entrances[me->entrance].sign;
        double line = scenario->line - 0.5 - me->station, gap = rvads_gap_ahead(&seen) - 2.0, speed = rvads_limit_at(&link, me->station);
        double soon = rvads_limit_at(&link, me->station + 4.0 * me->speed); /* to brake before a lower one */
        int patient, may = sign != RVADS_SIGN_LIGHTS || seen.lights[me->entrance] == RVADS_GREEN;
        if (soon < speed) speed = soon;
        if (link.fresh) stood = -1.0;
        if (me->zone == RVADS_ENTRANCE && me->speed < 0.05 && stood < 0) stood = seen.time;
        patient = sign != RVADS_SIGN_LIGHTS && stood >= 0 && seen.time - stood > 5; /* all stand and wait for each other */
        may = may && (sign != RVADS_SIGN_STOP || (stood >= 0 && seen.time - stood > 0.5));
        for (uint32_t k = 0; k < seen.others_count; ++k) {
            const rvads_vehicle *other = &seen.others[k];
            int due = other->zone <= RVADS_ENTRANCE && -other->station < 10 + 5 * other->speed &&
                      seen.lights[other->entrance] != RVADS_RED && scenario->control != RVADS_STOP_SIGNS &&
                      (other->speed > 0.05 || !patient);
            may = may && !(other->zone == RVADS_JUNCTION && rvads_conflicts_with(&link, other));
            may = may && !(due && rvads_gives_way_to(&link, other));
        }
        if (me->zone <= RVADS_ENTRANCE && !may && line < gap) gap = line;
        if (rvads_gap_to_pedestrians(&link, &seen, 4.0) - 0.5 < gap) gap = rvads_gap_to_pedestrians(&link, &seen, 4.0) - 0.5;
        if (rvads_stopping_speed(gap, 2.0) < speed) speed = rvads_stopping_speed(gap, 2.0);
        rvads_target_speed(&command, speed);
        rvads_answer(&link, &command);
    }
    return 0;
}
