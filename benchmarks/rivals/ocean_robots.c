// Steps environments of PufferLib's Ocean as fast as one core can: a line of seconds in, a line of JSON out.
//
//   cc -O3 -march=native -I FOLDER -DDRIVE ocean_robots.c -lm       (or -DTARGET)
//
// FOLDER holds `environment.h`, the environment's header up to its drawing, and an empty `raylib.h`, `raymath.h`,
// `rlgl.h`: `benchmarks/rivals/ocean.py` writes them. Actions were drawn before.
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#define PI 3.14159265358979323846f
typedef struct { unsigned id; } Texture2D;
#include "environment.h"

#define ACTIONS 16
#define ROBOTS 256

static double seconds(clockid_t clock) {
    struct timespec now;
    clock_gettime(clock, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

#ifdef DRIVE
typedef GPUDrive Environment;
static int robots_of(Environment* env) { return env->active_agent_count; }
static void make(Environment* env) {
    env->map_name = getenv("OCEAN_MAP");
    allocate(env);
}
static const int CHOICES[2] = {7, 13};
#else
typedef Target Environment;
static int robots_of(Environment* env) { return env->num_agents; }
static void make(Environment* env) {
    env->width = 1080, env->height = 720, env->num_agents = 8, env->num_goals = 4;
    init(env);
    env->observations = calloc(env->num_agents * (2 * (env->num_agents + env->num_goals) + 4), sizeof(float));
    env->actions = calloc(2 * env->num_agents, sizeof(int));
    env->rewards = calloc(env->num_agents, sizeof(float));
    env->terminals = calloc(env->num_agents, 1);
}
static const int CHOICES[2] = {9, 5};
#endif

int main(void) {
    static Environment environments[ROBOTS];
    static int drawn[ACTIONS][2 * ROBOTS];
    int count = 0, robots = 0;
    while (robots < ROBOTS) {
        make(&environments[count]);
        c_reset(&environments[count]);
        robots += robots_of(&environments[count++]);
    }
    for (int k = 0; k < ACTIONS; k++)
        for (int n = 0; n < 2 * ROBOTS; n++) drawn[k][n] = rand() % CHOICES[n % 2];
    printf("{\"robots\": %d}\n", robots);
    fflush(stdout);
    double asked_s;
    long ticks = 0;
    while (scanf("%lf", &asked_s) == 1) {
        double wall_s = seconds(CLOCK_MONOTONIC), cpu_s = seconds(CLOCK_PROCESS_CPUTIME_ID);
        long steps = 0;
        while (seconds(CLOCK_MONOTONIC) - wall_s < asked_s) {
            int* actions = drawn[ticks++ % ACTIONS];
            for (int k = 0; k < count; k++) {
                int wanted = robots_of(&environments[k]);
                memcpy(environments[k].actions, actions, 2 * (wanted < ROBOTS ? wanted : ROBOTS) * sizeof(int));
                c_step(&environments[k]);
            }
            steps += robots;
        }
        wall_s = seconds(CLOCK_MONOTONIC) - wall_s, cpu_s = seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu_s;
        printf("{\"steps\": %ld, \"wall_s\": %f, \"cpu_s\": %f}\n", steps, wall_s, cpu_s);
        fflush(stdout);
    }
    return 0;
}
