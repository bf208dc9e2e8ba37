/* rvads.h - attach a driving stack in C or C++ to pytest-rvads: this header is all there is to it.
 *
 *     rvads link;
 *     rvads_observation seen;
 *     rvads_command command;
 *     if (!rvads_open(&link, "my stack", 20.0)) return 1;
 *     while (rvads_next(&link, &seen)) {
 *         rvads_target_speed(&command, 8.0);
 *         rvads_answer(&link, &command);
 *     }
 *
 * rvads_next waits for the next observation and is false when the session is over. When it returns the first observation
 * of a new scenario, link.fresh is true and link.scenario describes it: forget what you know of the last one. Answer every
 * observation once. Whatever you print to standard output goes to standard error; the protocol has a descriptor of its own.
 *
 * With rvads_open you are not told of pedestrians and drive without seeing them. With rvads_open_with_pedestrians you also get
 * seen.pedestrians, seen.parked, seen.walks, link.crosswalks and link.covers.
 *
 * SI units throughout, angles in radians counter-clockwise. Little-endian POSIX systems. Licence: Apache-2.0.
 */
#ifndef RVADS_H
#define RVADS_H

#if defined __STRICT_ANSI__ && !defined _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L /* for the clock */
#endif
#include <errno.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RVADS_VERSION 2
#define RVADS_ENTRANCES 32 /* room for entrances, and for exits */
#define RVADS_OTHERS 63
#define RVADS_CROSSWALKS 32
#define RVADS_POINTS 64
#define RVADS_NAME 24 /* bytes of a name, the last of them 0 */
#define RVADS_NOWHERE 0xffffffffu

enum { RVADS_RIGHT, RVADS_STRAIGHT, RVADS_LEFT };                                  /* turn */
enum { RVADS_APPROACH, RVADS_ENTRANCE, RVADS_JUNCTION, RVADS_EXIT, RVADS_GONE };   /* zone */
enum { RVADS_NONE, RVADS_GREEN, RVADS_YELLOW, RVADS_RED };                         /* light */
enum { RVADS_STOP_SIGNS, RVADS_LIGHTS, RVADS_UNREGULATED, RVADS_PARTIAL, RVADS_YIELD_SIGNS }; /* control of the whole junction */
enum { RVADS_SIGN_NONE, RVADS_SIGN_STOP, RVADS_SIGN_YIELD, RVADS_SIGN_PRIORITY, RVADS_SIGN_LIGHTS }; /* of an entrance */
enum { RVADS_BY_MAP, RVADS_BY_SIGN, RVADS_BY_TURN, RVADS_BY_SIDE };                /* why one gives way: right before left, ... */
enum { RVADS_CAR, RVADS_TRUCK, RVADS_CYCLIST, RVADS_PEDESTRIAN };                  /* kind */
enum { RVADS_NEAR, RVADS_FAR }; /* side of a crosswalk: of the entrances of its arm, of the exits */

/* A vehicle as seen from outside; its position is that of the centre of its front bumper. */
typedef struct {
    uint32_t id; /* the same in every observation of a run, and nobody else's; 0 is your own vehicle */
    uint32_t kind;
    uint32_t entrance, lane; /* it came from or stands at; lanes of an arm count from the kerb */
    uint32_t turn;           /* it indicates */
    uint32_t zone;
    double station; /* along its way, 0 where the junction begins, negative before [m] */
    double x, y, heading, speed, acceleration, length, width;
    char name[RVADS_NAME]; /* as in reports: a0; a0.1 on lane 1 of an arm that has several; a0.1+1 the next behind; cut where longer */
} rvads_vehicle;

/* A pedestrian, or a vehicle that is parked before a crosswalk. The position of a pedestrian is that of the front of a circle. */
typedef struct {
    uint32_t id, kind;
    uint32_t crosswalk, side; /* the side that it comes from */
    uint32_t unused;
    uint32_t zone;  /* RVADS_JUNCTION is the roadway, RVADS_EXIT the sidewalk behind */
    double station; /* of a pedestrian: from the kerb that it comes from, negative on the sidewalk before [m] */
    double x, y, heading, speed, acceleration, length, width; /* the speed is negative if the pedestrian goes back */
    char name[RVADS_NAME];
} rvads_pedestrian;

typedef struct {
    double time; /* simulated, since the start of the run [s] */
    uint32_t step, others_count, entrances_count, unused;
    rvads_vehicle me;
    uint32_t lights[RVADS_ENTRANCES]; /* per entrance */
    rvads_vehicle others[RVADS_OTHERS];
    uint32_t pedestrians_count, parked_count;
    uint32_t walks[RVADS_CROSSWALKS]; /* pedestrian light of each crosswalk: green is WALK, yellow flashing DON'T WALK */
    rvads_pedestrian pedestrians[RVADS_OTHERS], parked[RVADS_OTHERS];
} rvads_observation;

typedef struct {
    uint32_t arm, lane, sign;
    int32_t phase;       /* those of one phase get green together; -1 without a light */
    double setback;      /* stopping line before the end of the lane [m]; negative behind it */
    double sign_setback; /* stop sign before the junction [m] */
} rvads_entrance;

typedef struct {
    uint32_t arm, lane;
} rvads_exit;

/* One scenario: where to go, what regulates the junction, what the vehicle can do. Arms are numbered counter-clockwise. */
typedef struct {
    uint32_t arms_count, entrances_count, exits_count, control, left_hand, entrance, exit, turn;
    uint32_t movements_count, conflicts_count, yields_count, path_count, text_size, crosswalks_count;
    double period;      /* between two observations [s] */
    double speed_limit; /* where the vehicle starts; see rvads_limit_at [m/s] */
    double line, length, end; /* stations: stopping line, end of the junction, end of the way [m] */
    double vehicle_length, vehicle_width, wheelbase, rear_axle_offset; /* the offset is from the front bumper [m] */
    double drive, brake; /* full acceleration and full service brake [m/s^2] */
    double steering_limit, steering_rate;
    rvads_entrance entrances[RVADS_ENTRANCES];
    rvads_exit exits[RVADS_ENTRANCES];
    uint8_t right_of[RVADS_ENTRANCES][RVADS_ENTRANCES], opposite[RVADS_ENTRANCES][RVADS_ENTRANCES]; /* of entrances */
} rvads_scenario;

typedef struct {
    uint32_t entrance, exit, turn, unused;
    double length; /* [m] */
} rvads_movement;

typedef struct { /* two movements, by their place in the list, that can't be made at once */
    uint32_t one, other;
} rvads_pair;

typedef struct { /* two movements: the one gives way to the other */
    uint32_t one, other, reason, unused;
} rvads_yield;

typedef struct {
    double station, x, y, heading;
} rvads_point;

typedef struct { /* a crosswalk; its corners and its line are in the text of the link */
    uint32_t arm;
    int32_t phase;         /* pedestrians may walk while this phase of entrances has green; -1 without a light */
    double length, middle; /* from the near kerb to the far kerb, to the middle of the roadway or of its island [m] */
    double island;         /* width of the island, 0 without one [m] */
} rvads_crosswalk;

typedef struct { /* where a movement leads over a crosswalk */
    uint32_t crosswalk, movement;
    double start, end;           /* of the painted area, as stations of the movement; negative before the junction [m] */
    double walk_start, walk_end; /* of the strip that vehicles take up, from the near kerb [m] */
} rvads_cover;

typedef struct {
    uint32_t kind, count, step, unused;
    double value[3], compute, points[RVADS_POINTS][3];
} rvads_command;

typedef struct {
    int fresh;               /* true with the first observation of a scenario */
    rvads_scenario scenario;
    rvads_movement *movements; /* as many as the scenario counts, and so on */
    rvads_pair *conflicts;
    rvads_yield *yields;
    rvads_point *path;       /* the own way by the metre */
    char *text;              /* the whole reset message as JSON, with the map; ends with a 0 */
    rvads_crosswalk *crosswalks; /* without pedestrians, there are none */
    rvads_cover *covers;
    uint32_t covers_count;
    int with_pedestrians;
    int output;
    uint32_t step;
#ifdef CLOCK_MONOTONIC /* hidden where another header came before this one under -std=c99 */
    struct timespec since;
#endif
} rvads;

static inline int rvads_fail_(const char *what) {
    fprintf(stderr, "rvads: %s\n", what);
    return 0;
}

static inline int rvads_write_(int file, const void *data, size_t size) {
    const char *at = (const char *)data;
    while (size > 0) {
        ssize_t done = write(file, at, size);
        if (done < 0 && errno == EINTR) continue;
        if (done <= 0) return 0;
        at += done;
        size -= (size_t)done;
    }
    return 1;
}

static inline int rvads_read_(void *data, size_t size) {
    char *at = (char *)data;
    while (size > 0) {
        ssize_t done = read(0, at, size);
        if (done < 0 && errno == EINTR) continue;
        if (done <= 0) return 0;
        at += done;
        size -= (size_t)done;
    }
    return 1;
}

static inline int rvads_open_(rvads *link, const char *name, double rate, int with_pedestrians) {
    char line[256], want[64] = "", plain[81] = "";
    size_t used = 0;
    memset(link, 0, sizeof *link);
    link->with_pedestrians = with_pedestrians;
    link->output = dup(1);
    if (link->output < 0 || dup2(2, 1) < 0) return rvads_fail_("standard output or error is closed");
    while (used + 1 < sizeof line && rvads_read_(line + used, 1) && line[used] != '\n') ++used;
    line[used] = 0;
    if (!strstr(line, "\"protocol\":\"rvads\"")) return rvads_fail_("this program is to be started by pytest-rvads");
    for (used = 0; name[used] && used + 1 < sizeof plain; ++used) /* JSON would have these escaped */
        plain[used] = name[used] < ' ' || name[used] == '"' || name[used] == '\\' || name[used] == 127 ? '_' : name[used];
    if (rate > 0) snprintf(want, sizeof want, ",\"rate\":%.17g", rate);
    used = (size_t)snprintf(line, sizeof line, "{\"type\":\"hello\",\"version\":%d,\"format\":\"binary\",\"name\":\"%s\"%s%s}\n",
                            RVADS_VERSION, plain, want, with_pedestrians ? ",\"pedestrians\":true" : "");
    return rvads_write_(link->output, line, used) || rvads_fail_("nobody listens");
}

/* Say hello. `rate` is how often you want to be asked [Hz], 0 for the default. Returns false when nobody answers. */
static inline int rvads_open(rvads *link, const char *name, double rate) {
    return rvads_open_(link, name, rate, 0);
}

/* Say hello, and ask for pedestrians and crosswalks. */
static inline int rvads_open_with_pedestrians(rvads *link, const char *name, double rate) {
    return rvads_open_(link, name, rate, 1);
}

/* Read a list of `count` items in place of the last one; a 0 follows it. Returns NULL where it can't be had. */
static inline void *rvads_list_(void *old, uint32_t count, uint32_t item, uint32_t *left) {
    void *list = count <= *left / item ? calloc((size_t)count + 1, item) : NULL;
    free(old);
    if (!list || !rvads_read_(list, (size_t)count * item)) {
        free(list);
        return NULL;
    }
    *left -= count * item;
    return list;
}

/* Is all that a scenario counts and refers to there? */
static inline int rvads_whole_(const rvads *link) {
    const rvads_scenario *now = &link->scenario;
    uint32_t k, entrances = now->entrances_count, exits = now->exits_count, movements = now->movements_count;
    int whole = link->movements && link->conflicts && link->yields && link->path && link->text && entrances <= RVADS_ENTRANCES &&
                exits <= RVADS_ENTRANCES && now->entrance < entrances && now->exit < exits && link->crosswalks && link->covers &&
                now->crosswalks_count <= RVADS_CROSSWALKS;
    for (k = 0; whole && k < link->covers_count; ++k)
        whole = link->covers[k].crosswalk < now->crosswalks_count && link->covers[k].movement < movements;
    for (k = 0; whole && k < movements; ++k)
        whole = link->movements[k].entrance < entrances && link->movements[k].exit < exits;
    for (k = 0; whole && k < now->conflicts_count; ++k)
        whole = link->conflicts[k].one < movements && link->conflicts[k].other < movements;
    for (k = 0; whole && k < now->yields_count; ++k)
        whole = link->yields[k].one < movements && link->yields[k].other < movements;
    return whole;
}

static inline int rvads_reset_(rvads *link, uint32_t size) {
    static const uint32_t ready[2] = {2, 0};
    rvads_scenario *now = &link->scenario;
    if (size < sizeof *now || !rvads_read_(now, sizeof *now)) return rvads_fail_("the reset is cut short");
    size -= (uint32_t)sizeof *now;
    link->movements = (rvads_movement *)rvads_list_(link->movements, now->movements_count, sizeof(rvads_movement), &size);
    link->conflicts = (rvads_pair *)rvads_list_(link->conflicts, now->conflicts_count, sizeof(rvads_pair), &size);
    link->yields = (rvads_yield *)rvads_list_(link->yields, now->yields_count, sizeof(rvads_yield), &size);
    link->path = (rvads_point *)rvads_list_(link->path, now->path_count, sizeof(rvads_point), &size);
    link->text = (char *)rvads_list_(link->text, now->text_size, 1, &size);
    link->crosswalks = (rvads_crosswalk *)rvads_list_(link->crosswalks, now->crosswalks_count, sizeof(rvads_crosswalk), &size);
    link->covers_count = size / (uint32_t)sizeof(rvads_cover);
    link->covers = (rvads_cover *)rvads_list_(link->covers, link->covers_count, sizeof(rvads_cover), &size);
    if (size || !rvads_whole_(link)) return rvads_fail_("the reset is not what it says, or there is no memory for it");
    link->fresh = 1;
    return rvads_write_(link->output, ready, sizeof ready);
}

/* Read `count` pedestrians; false where they are not what they say. */
static inline int rvads_pedestrians_(const rvads *link, rvads_pedestrian *list, uint32_t count) {
    uint32_t k;
    if (!rvads_read_(list, (size_t)count * sizeof *list)) return 0;
    for (k = 0; k < count; ++k) {
        list[k].name[RVADS_NAME - 1] = 0;
        if (list[k].crosswalk >= link->scenario.crosswalks_count) return 0;
    }
    return 1;
}

/* Read an observation; false where it is not what it says. */
static inline int rvads_observe_(const rvads *link, rvads_observation *seen, uint32_t size) {
    const size_t last = RVADS_NAME - 1;
    const size_t fixed = offsetof(rvads_observation, others);
    const size_t tail = offsetof(rvads_observation, pedestrians) - offsetof(rvads_observation, pedestrians_count);
    size_t left;
    uint32_t k, entrances = link->scenario.entrances_count;
    int whole = size >= fixed && rvads_read_(seen, fixed);
    left = whole ? size - fixed : 0;
    seen->pedestrians_count = seen->parked_count = 0;
    whole = whole && seen->others_count <= RVADS_OTHERS && seen->others_count * sizeof seen->me <= left &&
            seen->entrances_count == entrances && seen->me.entrance < entrances &&
            rvads_read_(seen->others, seen->others_count * sizeof seen->me);
    if (whole) left -= seen->others_count * sizeof seen->me;
    for (k = 0; whole && k < seen->others_count; ++k) {
        whole = seen->others[k].entrance < entrances;
        seen->others[k].name[last] = 0;
    }
    if (whole && link->with_pedestrians) {
        whole = left >= tail && rvads_read_(&seen->pedestrians_count, tail) && seen->pedestrians_count <= RVADS_OTHERS &&
                seen->parked_count <= RVADS_OTHERS &&
                left == tail + (seen->pedestrians_count + seen->parked_count) * sizeof *seen->parked &&
                rvads_pedestrians_(link, seen->pedestrians, seen->pedestrians_count) &&
                rvads_pedestrians_(link, seen->parked, seen->parked_count);
        left = 0;
    }
    seen->me.name[last] = 0;
    return (whole && left == 0) || rvads_fail_("an observation is not what it says");
}

/* Wait for the next observation; false when the session is over. */
static inline int rvads_next(rvads *link, rvads_observation *seen) {
    uint32_t head[2];
    link->fresh = 0;
    while (rvads_read_(head, sizeof head)) {
        if (head[0] == 1 && rvads_reset_(link, head[1])) continue;
        if (head[0] == 3 && rvads_observe_(link, seen, head[1])) {
            link->step = seen->step;
#ifdef CLOCK_MONOTONIC
            clock_gettime(CLOCK_MONOTONIC, &link->since);
#endif
            return 1;
        }
        if (head[0] != 1 && head[0] != 3 && head[0] != 5)
            rvads_fail_("a frame of unknown kind: build with the client that belongs to this pytest-rvads");
        break;
    }
    free(link->movements), free(link->conflicts), free(link->yields), free(link->path), free(link->text);
    free(link->crosswalks), free(link->covers);
    memset(link, 0, sizeof *link);
    return 0;
}

/* The commands. Each is held until the next answer; all but the controls are driven by the tracking controller. */
static inline void rvads_controls(rvads_command *command, double throttle, double brake, double steering) {
    memset(command, 0, sizeof *command);
    command->value[0] = throttle;
    command->value[1] = brake;
    command->value[2] = steering;
}

static inline void rvads_target_speed(rvads_command *command, double speed) {
    memset(command, 0, sizeof *command);
    command->kind = 1;
    command->value[0] = speed;
}

static inline void rvads_acceleration(rvads_command *command, double acceleration) { /* the steering follows the own way */
    memset(command, 0, sizeof *command);
    command->kind = 2;
    command->value[0] = acceleration;
}

static inline void rvads_steered_acceleration(rvads_command *command, double acceleration, double steering) {
    rvads_acceleration(command, acceleration);
    command->kind = 3;
    command->value[1] = steering;
}

static inline void rvads_trajectory(rvads_command *command) { /* then add points, in order of time */
    memset(command, 0, sizeof *command);
    command->kind = 4;
}

static inline int rvads_add_point(rvads_command *command, double time, double x, double y) { /* false when there is no room */
    double point[3] = {time, x, y};
    if (command->count >= RVADS_POINTS) return 0;
    memcpy(command->points[command->count++], point, sizeof point);
    return 1;
}

/* Answer the last observation; false when nobody listens any more. */
static inline int rvads_answer(rvads *link, rvads_command *command) {
    struct { uint32_t head[2]; rvads_command command; } frame = {{4, sizeof *command}, *command};
#ifdef CLOCK_MONOTONIC
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    frame.command.compute = (double)(now.tv_sec - link->since.tv_sec) + 1e-9 * (double)(now.tv_nsec - link->since.tv_nsec);
#else
    frame.command.compute = -1; /* not known */
#endif
    frame.command.step = link->step;
    return rvads_write_(link->output, &frame, sizeof frame);
}

/* The speed limit at a station of the own way [m/s]: of all that begin up to there, the last one holds. */
static inline double rvads_limit_at(const rvads *link, double station) {
    static const char name[] = "\"speed_limits\":[";
    const char *at = strstr(link->text, name);
    double limit = link->scenario.speed_limit;
    int first = 1;
    if (at) at += sizeof name - 1;
    while (at && *at == '[') { /* [station,limit], and so on */
        char *end;
        double begins = strtod(at + 1, &end), value = strtod(*end ? end + 1 : end, &end);
        if (first || begins <= station) limit = value;
        first = 0;
        at = *end && end[1] == ',' ? end + 2 : NULL;
    }
    return limit;
}

/* The own movement, by its place in the list; RVADS_NOWHERE where it is not in it. */
static inline uint32_t rvads_own_movement(const rvads *link) {
    uint32_t k;
    for (k = 0; k < link->scenario.movements_count; ++k)
        if (link->movements[k].entrance == link->scenario.entrance && link->movements[k].exit == link->scenario.exit) return k;
    return RVADS_NOWHERE;
}

/* May a vehicle be about to make a movement, or make it? It goes by where it comes from and what it indicates. */
static inline int rvads_may_make(const rvads *link, const rvads_vehicle *vehicle, uint32_t movement) {
    const rvads_movement *way = &link->movements[movement];
    return way->entrance == vehicle->entrance && way->turn == vehicle->turn;
}

/* Can the own movement not be made together with one that this vehicle may make? */
static inline int rvads_conflicts_with(const rvads *link, const rvads_vehicle *other) {
    uint32_t k, own = rvads_own_movement(link);
    for (k = 0; k < link->scenario.conflicts_count; ++k)
        if (link->conflicts[k].one == own && rvads_may_make(link, other, link->conflicts[k].other)) return 1;
    return 0;
}

/* Does the own movement give way to one that this vehicle may make? */
static inline int rvads_gives_way_to(const rvads *link, const rvads_vehicle *other) {
    uint32_t k, own = rvads_own_movement(link);
    for (k = 0; k < link->scenario.yields_count; ++k)
        if (link->yields[k].one == own && rvads_may_make(link, other, link->yields[k].other)) return 1;
    return 0;
}

/* The free road to whoever drives ahead in the own lane before the junction [m]; 1000 where nobody does. */
static inline double rvads_gap_ahead(const rvads_observation *seen) {
    double gap = 1000.0;
    for (uint32_t k = 0; k < seen->others_count; ++k) {
        const rvads_vehicle *other = &seen->others[k];
        double free = other->station - other->length - seen->me.station;
        int ahead = other->entrance == seen->me.entrance && other->station > seen->me.station && other->zone <= RVADS_JUNCTION;
        if (ahead && free < gap) gap = free;
    }
    return gap;
}

/* The free road up to the first crosswalk ahead on which somebody walks in the own lane, or would within `soon` seconds at the
 * present speed [m]; 1000 without one. */
static inline double rvads_gap_to_pedestrians(const rvads *link, const rvads_observation *seen, double soon) {
    double gap = 1000.0;
    uint32_t k, p, own = rvads_own_movement(link);
    for (k = 0; k < link->covers_count; ++k) {
        const rvads_cover *cover = &link->covers[k];
        double free = cover->start - seen->me.station;
        if (cover->movement != own || cover->end < seen->me.station) continue;
        for (p = 0; p < seen->pedestrians_count; ++p) {
            const rvads_pedestrian *person = &seen->pedestrians[p];
            int far = person->side == RVADS_FAR;
            double length = link->crosswalks[cover->crosswalk].length;
            double from = far ? length - cover->walk_end : cover->walk_start, to = far ? length - cover->walk_start : cover->walk_end;
            double front = person->station, rear = front - person->length;
            if (person->speed > 0.0) front += soon * person->speed;
            if (person->speed < 0.0) rear += soon * person->speed;
            if (person->crosswalk == cover->crosswalk && front > from && rear < to && free < gap) gap = free;
        }
    }
    return gap;
}

/* The speed from which braking at `deceleration` [m/s^2] ends after `distance` [m]; 0 from there on. */
static inline double rvads_stopping_speed(double distance, double deceleration) {
    double square = 2.0 * deceleration * distance, root = square > 1.0 ? square : 1.0;
    if (square <= 0.0) return 0.0;
    for (int k = 0; k < 24; ++k) root = 0.5 * (root + square / root); /* Newton, so that nobody has to link libm */
    return root;
}

#ifdef __cplusplus
}
#endif
#endif
