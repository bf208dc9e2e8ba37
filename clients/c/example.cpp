// Keeps its distance, stops at stop signs, red lights and for pedestrians, gives way to who came first or from the right.
#include "rvads.h"    // g++ -O2 -o stack example.cpp
#include <algorithm>
#include <set>
int main() {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    double since = -1.0, stood = -1.0, moved = -1.0;
    std::set<uint32_t> first, ahead;
    if (!rvads_open_with_pedestrians(&link, "example", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        const rvads_vehicle &me = seen.me;
        const rvads_scenario &scenario = link.scenario;
        const uint32_t sign = scenario.entrances[me.entrance].sign;
        if (link.fresh) since = stood = moved = -1.0, first.clear();
        if (me.zone != RVADS_APPROACH && since < 0) since = seen.time;
        if (me.zone == RVADS_ENTRANCE && me.speed < 0.05 && stood < 0) stood = seen.time;
        bool patient = sign != RVADS_SIGN_LIGHTS && stood >= 0 && seen.time - std::max(stood, moved) > 5;  // all wait
        bool clear = true, due = false, tie = since >= 0 && seen.time - since <= 0.5;  // at about the same time
        for (uint32_t k = 0; k < seen.others_count; ++k) {
            const rvads_vehicle &other = seen.others[k];
            if (other.zone > RVADS_JUNCTION || other.entrance == me.entrance) continue;
            if (other.zone == RVADS_JUNCTION) moved = seen.time, clear = clear && !rvads_conflicts_with(&link, &other);
            bool comes = rvads_gives_way_to(&link, &other) && other.zone <= RVADS_ENTRANCE && -other.station < 10 + 7 * other.speed;
            due |= comes && seen.lights[other.entrance] != RVADS_RED && (other.speed > 0.05 || !patient);
            bool earlier = me.zone == RVADS_APPROACH || (tie && scenario.right_of[other.entrance][me.entrance]) || first.count(other.id);
            if (other.zone == RVADS_ENTRANCE && earlier) ahead.insert(other.id);
        }
        first.swap(ahead), ahead.clear();
        bool may = clear && (scenario.control == RVADS_STOP_SIGNS ? patient || first.empty() : !due);
        may = may && (sign != RVADS_SIGN_STOP || (stood >= 0 && seen.time - stood > 0.5));
        may = may && (sign != RVADS_SIGN_LIGHTS || seen.lights[me.entrance] == RVADS_GREEN);
        double gap = std::min(rvads_gap_ahead(&seen) - 2.0, rvads_gap_to_pedestrians(&link, &seen, 4.0) - 0.5);
        if (me.zone <= RVADS_ENTRANCE && !may) gap = std::min(gap, scenario.line - 0.5 - me.station);
        double limit = std::min(rvads_limit_at(&link, me.station), rvads_limit_at(&link, me.station + 4.0 * me.speed));  // in time
        rvads_target_speed(&command, std::min(rvads_stopping_speed(gap, 2.0), limit));
        rvads_answer(&link, &command);
    }
}
