/* The steady clock of a process with rclcpp follows simulated time here: its wall timers, rates, sleeps and time-outs.
 *
 * Preloaded (ld.so(8)), it stands before functions of rcutils, rcl, rmw, the C and the C++ library. It asks for no
 * version of the C library, since an image may bring any, and does nothing in a process that has no rclcpp, or no clock
 * that follows /clock. The middleware keeps the machine's clock: it is known by the address that a call returns to.
 *
 * Steady time begins at EPOCH, later than any machine's, so a time tells by itself which clock it was read from. It
 * stands while nodes start. Whoever waits for a time waits without a limit, and is woken when rcl is told the time.
 * So does the system's clock, by which rclcpp::Rate goes that is given no other. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <linux/futex.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define BILLION 1000000000LL
/* Simulated time when an episode begins, and the steady clock's until then. */
#define BEGINS (1 * BILLION)
#define EPOCH (100000000 * BILLION)
/* The system's clock begins at DATE, later than any machine's, too: who waits for a time read before is not left behind. */
#define DATE (4000000000 * BILLION)
#define CLOCKS 256
#define CALLERS 4096

#define OURS __attribute__((visibility("default")))
#define CALLER __builtin_return_address(0)
#define LOAD(what) __atomic_load_n(&(what), __ATOMIC_ACQUIRE)
#define STORE(what, value) __atomic_store_n(&(what), value, __ATOMIC_RELEASE)
/* What stands behind this library: of the program, or of rcl and what it needs, which Python loads for itself. */
#define BEHIND(name) ({ \
  static __typeof__(&name) found; \
  if (!LOAD(found)) STORE(found, (__typeof__(&name))behind(#name)); \
  LOAD(found); })

static void *behind(const char *name) {
  /* Of functions that glibc has twice the first version is another one. */
  void *found = strncmp(name, "pthread_cond_", 13) ? NULL : dlvsym(RTLD_NEXT, name, "GLIBC_2.3.2"), *rcl;
  if (!found) found = dlsym(RTLD_NEXT, name);
  if (!found && (rcl = dlopen("librcl.so", RTLD_LAZY | RTLD_NOLOAD))) found = dlsym(rcl, name);
  return found;
}

static bool has_rclcpp(void) { return dlopen("librclcpp.so", RTLD_LAZY | RTLD_NOLOAD) != NULL; }

/* Whether a clock of this process follows /clock; what it was told, 0 while nodes start; whether this thread tells it. */
static bool follows;
static int64_t told_ns;
static __thread bool tells;
/* Whether this thread published while nodes started: if it sleeps, it may do so again when it wakes. */
static __thread bool published;

static int64_t nanoseconds(const struct timespec *time) { return time->tv_sec * BILLION + time->tv_nsec; }

/* Returns the steady clock's time at which a wait is over; 0 for one that goes by the machine's clock. */
static int64_t steady_until(clockid_t clock, int64_t ns) {
  if (clock == CLOCK_MONOTONIC && ns >= EPOCH) return ns;
  return clock == CLOCK_REALTIME && ns >= DATE ? ns - DATE + EPOCH : 0;
}

static struct timespec timespec_of(int64_t ns) { return (struct timespec){ns / BILLION, ns % BILLION}; }

static int64_t machine_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return nanoseconds(&now);
}

static int64_t simulated_ns(void) {
  int64_t now = LOAD(told_ns);
  return now ? EPOCH + now - BEGINS : EPOCH;
}

/* Returns whether a call comes from what keeps the machine's clock: the middleware, and what is no node's own code. */
static bool of_machine(const void *caller) {
  static const char *const names[] = {"libfast",       "librmw",   "libdds", "libcyclone",  "libiceoryx", "libzenoh",
                                      "libtracetools", "liblttng", "libc.",  "libpthread",  "ld-",        "libstdc++",
                                      "libpython",     "python"};
  static uintptr_t known[CALLERS];
  uintptr_t at = (uintptr_t)caller, *place = &known[at % CALLERS], cached = LOAD(*place);
  if (cached >> 1 == (at & ~(uintptr_t)0 >> 1)) return cached & 1;
  Dl_info info;
  bool found = false;
  if (dladdr(caller, &info) && info.dli_fname) {
    const char *slash = strrchr(info.dli_fname, '/'), *name = slash ? slash + 1 : info.dli_fname;
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) found |= !strncmp(name, names[k], strlen(names[k]));
  }
  STORE(*place, at << 1 | found);
  return found;
}

static bool simulated(const void *caller) { return LOAD(follows) && !of_machine(caller); }

/* Who waits for simulated time. */
struct waiter {
  struct waiter *next;
  int64_t until;    /* of the steady clock */
  const void *on;   /* what may end the wait before that */
  void *guard;      /* what ends it, where it is the middleware's */
  uint32_t woken;   /* by time, or by a signal; or its time was past already */
};
enum { TIME = 1, SIGNAL = 2, PAST = 3 };
static struct waiter *waiters;
static int on_something;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static __thread bool holds;

static void hold(void) {
  pthread_mutex_lock(&lock);
  holds = true;
}

static void release(void) {
  holds = false;
  pthread_mutex_unlock(&lock);
}

extern int rmw_trigger_guard_condition(const void *guard);

static void wake(struct waiter *each, uint32_t by) {
  STORE(each->woken, by);
  if (each->guard) BEHIND(rmw_trigger_guard_condition)(each->guard);
  else syscall(SYS_futex, &each->woken, FUTEX_WAKE_PRIVATE, 1, NULL, NULL, 0);
}

static void add(struct waiter *own) {
  hold();
  own->next = waiters;
  waiters = own;
  __atomic_add_fetch(&on_something, own->on != NULL, __ATOMIC_SEQ_CST);
  own->woken = own->until <= simulated_ns() ? PAST : 0;
  release();
}

static void take_out(struct waiter *own) {
  hold();
  struct waiter **place = &waiters;
  while (*place != own) place = &(*place)->next;
  *place = own->next;
  __atomic_sub_fetch(&on_something, own->on != NULL, __ATOMIC_SEQ_CST);
  release();
}

/* Waits for its turn: lock-step holds such a nap, and ends one at a time, when all else sleeps (nap_gate.py). */
static void take_turn(void) {
  struct timespec held = {0, BILLION / 1000};
  syscall(SYS_nanosleep, &held, NULL);
}

/* Waits until somebody wakes the waiter; while nodes start, until the machine's clock has a time if that is given. */
static void rest(struct waiter *own, int64_t machine_until) {
  while (!LOAD(own->woken)) {
    struct timespec left = {0}, *limit = NULL;
    if (machine_until && !LOAD(told_ns)) {
      int64_t ns = machine_until - machine_ns();
      if (ns <= 0) break;
      left = timespec_of(ns);
      limit = &left;
    }
    syscall(SYS_futex, &own->woken, FUTEX_WAIT_PRIVATE, 0, limit, NULL, 0);
  }
  take_out(own);
  if (own->woken == TIME) take_turn();
}

static void end_waits(const void *on, bool all) {
  if (holds || !__atomic_load_n(&on_something, __ATOMIC_SEQ_CST)) return;
  hold();
  for (struct waiter *each = waiters; each; each = each->next)
    if (each->on == on && !each->woken) {
      wake(each, SIGNAL);
      if (!all) break;
    }
  release();
}

static void wake_due(void) {
  for (struct waiter *each = waiters; each; each = each->next)
    if (each->until <= simulated_ns() && !each->woken) wake(each, TIME);
}

/* rcl's clocks, one for each node of a process. Steady time goes on when all have heard of a tick; one that missed the
 * tick before, as of a node that is gone, is not waited for. */
static struct { const void *clock; int64_t ns; } clocks[CLOCKS];

extern int rcl_enable_ros_time_override(void *clock), rcl_set_ros_time_override(void *clock, int64_t ns);

OURS int rcl_enable_ros_time_override(void *clock) {
  int failed = BEHIND(rcl_enable_ros_time_override)(clock);
  if (!failed && has_rclcpp()) STORE(follows, true);
  return failed;
}

OURS int rcl_set_ros_time_override(void *clock, int64_t ns) {
  int64_t next = LOAD(told_ns);
  if (LOAD(follows)) {
    hold();
    size_t own = 0;
    while (own < CLOCKS - 1 && clocks[own].clock && clocks[own].clock != clock) own++;
    int64_t before = clocks[own].clock == clock ? clocks[own].ns : 0, least = ns;
    clocks[own].clock = clock;
    clocks[own].ns = ns;
    next = before > told_ns ? before : told_ns;
    for (size_t k = 0; k < CLOCKS && clocks[k].clock; k++)
      if (clocks[k].ns >= next && clocks[k].ns < least) least = clocks[k].ns;
    if (least > next) next = least;
    tells |= next > told_ns;
    /* Before rcl wakes who waits for its own clock: what that one does next takes the same time on each machine. */
    STORE(told_ns, next);
    release();
  }
  int failed = BEHIND(rcl_set_ros_time_override)(clock, ns);
  if (LOAD(follows)) {
    hold();
    wake_due();
    release();
  }
  return failed;
}

extern const char *rcl_publisher_get_topic_name(const void *publisher);
extern int rcl_publish(const void *publisher, const void *message, void *allocation);

OURS int rcl_publish(const void *publisher, const void *message, void *allocation) {
  if (LOAD(follows) && !published && !LOAD(told_ns)) {
    const char *topic = BEHIND(rcl_publisher_get_topic_name)(publisher);
    published = topic && strcmp(topic, "/rosout") && strcmp(topic, "/parameter_events");
  }
  return BEHIND(rcl_publish)(publisher, message, allocation);
}

/* What reads the steady clock. */

extern int rcutils_steady_time_now(int64_t *now);

OURS int rcutils_steady_time_now(int64_t *now) {
  if (!now || !simulated(CALLER)) return BEHIND(rcutils_steady_time_now)(now);
  *now = simulated_ns();
  return 0;
}

/* std::chrono::steady_clock::now() */
OURS int64_t _ZNSt6chrono3_V212steady_clock3nowEv(void) { return simulated(CALLER) ? simulated_ns() : machine_ns(); }

/* What reads the system's: rclcpp::Rate that is given no clock. */

extern int rcutils_system_time_now(int64_t *now);

OURS int rcutils_system_time_now(int64_t *now) {
  if (!now || !simulated(CALLER)) return BEHIND(rcutils_system_time_now)(now);
  *now = simulated_ns() - EPOCH + DATE;
  return 0;
}

/* std::chrono::system_clock::now() */
OURS int64_t _ZNSt6chrono3_V212system_clock3nowEv(void) {
  struct timespec now;
  if (simulated(CALLER)) return simulated_ns() - EPOCH + DATE;
  clock_gettime(CLOCK_REALTIME, &now);
  return nanoseconds(&now);
}

/* Who sleeps. While nodes start a sleep takes as long as it says, but for a thread that would publish again after it:
 * that would go on so until the episode begins. */

static bool slept(const void *caller, int64_t length, int64_t until) {
  if (!simulated(caller) || tells || length <= 0) return false;
  struct waiter own = {.until = until};
  add(&own);
  rest(&own, published ? 0 : machine_ns() + length);
  return true;
}

static bool slept_for(const void *caller, const struct timespec *length) {
  return length && slept(caller, nanoseconds(length), simulated_ns() + nanoseconds(length));
}

OURS int nanosleep(const struct timespec *length, struct timespec *left) {
  return slept_for(CALLER, length) ? 0 : BEHIND(nanosleep)(length, left);
}

OURS int clock_nanosleep(clockid_t clock, int flags, const struct timespec *time, struct timespec *left) {
  int64_t until = time && flags & TIMER_ABSTIME ? steady_until(clock, nanoseconds(time)) : 0;
  if (until ? slept(CALLER, until - simulated_ns(), until) || true : !(flags & TIMER_ABSTIME) && slept_for(CALLER, time))
    return 0;
  return BEHIND(clock_nanosleep)(clock, flags, time, left);
}

OURS int usleep(useconds_t length) {
  struct timespec time = timespec_of(length * 1000LL);
  return slept_for(CALLER, &time) ? 0 : BEHIND(usleep)(length);
}

OURS unsigned sleep(unsigned length) {
  struct timespec time = {length, 0};
  return slept_for(CALLER, &time) ? 0 : BEHIND(sleep)(length);
}

/* Who waits on a condition: std::condition_variable. */

static int condition_wait(pthread_cond_t *on, pthread_mutex_t *mutex, int64_t until) {
  struct waiter own = {.until = until, .on = on};
  add(&own);
  pthread_mutex_unlock(mutex);
  rest(&own, 0);
  pthread_mutex_lock(mutex);
  return own.woken == SIGNAL ? 0 : ETIMEDOUT;
}

OURS int pthread_cond_clockwait(pthread_cond_t *on, pthread_mutex_t *mutex, clockid_t clock, const struct timespec *time) {
  int64_t until = steady_until(clock, nanoseconds(time));
  return until ? condition_wait(on, mutex, until) : BEHIND(pthread_cond_clockwait)(on, mutex, clock, time);
}

OURS int pthread_cond_timedwait(pthread_cond_t *on, pthread_mutex_t *mutex, const struct timespec *time) {
  int64_t until = steady_until(CLOCK_REALTIME, nanoseconds(time));
  return until ? condition_wait(on, mutex, until) : BEHIND(pthread_cond_timedwait)(on, mutex, time);
}

OURS int pthread_cond_signal(pthread_cond_t *on) {
  end_waits(on, false);
  return BEHIND(pthread_cond_signal)(on);
}

OURS int pthread_cond_broadcast(pthread_cond_t *on) {
  end_waits(on, true);
  return BEHIND(pthread_cond_broadcast)(on);
}

/* Who waits for a std::future: std::__atomic_futex_unsigned_base, its waits until a time, and what ends them. */

#define WAIT _ZNSt28__atomic_futex_unsigned_base26_M_futex_wait_until_steadyEPjjbNSt6chrono8durationIlSt5ratioILl1ELl1EEEENS2_IlS3_ILl1ELl1000000000EEEE
#define WAIT_SYSTEM _ZNSt28__atomic_futex_unsigned_base19_M_futex_wait_untilEPjjbNSt6chrono8durationIlSt5ratioILl1ELl1EEEENS2_IlS3_ILl1ELl1000000000EEEE
#define NOTIFY _ZNSt28__atomic_futex_unsigned_base19_M_futex_notify_allEPj
#define NAME(name) BEHIND(name)  /* expands it first */
extern bool WAIT(void *base, unsigned *value, unsigned old, bool limited, int64_t s, int64_t ns);
extern bool WAIT_SYSTEM(void *base, unsigned *value, unsigned old, bool limited, int64_t s, int64_t ns);
extern void NOTIFY(unsigned *value);

static bool future_wait(unsigned *value, unsigned old, int64_t until) {
  struct waiter own = {.until = until, .on = value};
  add(&own);
  if (LOAD(*value) != old) take_out(&own);
  else rest(&own, 0);
  return own.woken == SIGNAL || LOAD(*value) != old;
}

OURS bool WAIT(void *base, unsigned *value, unsigned old, bool limited, int64_t s, int64_t ns) {
  int64_t until = limited ? steady_until(CLOCK_MONOTONIC, s * BILLION + ns) : 0;
  return until ? future_wait(value, old, until) : NAME(WAIT)(base, value, old, limited, s, ns);
}

OURS bool WAIT_SYSTEM(void *base, unsigned *value, unsigned old, bool limited, int64_t s, int64_t ns) {
  int64_t until = limited ? steady_until(CLOCK_REALTIME, s * BILLION + ns) : 0;
  return until ? future_wait(value, old, until) : NAME(WAIT_SYSTEM)(base, value, old, limited, s, ns);
}

OURS void NOTIFY(unsigned *value) {
  end_waits(value, true);
  NAME(NOTIFY)(value);
}

/* Who waits for a lock until a time gets it or waits so long by the machine's clock. */
#define BY_MACHINE(name, type) \
  OURS int name(type *what, clockid_t clock, const struct timespec *until) { \
    struct timespec time = *until; \
    if (clock == CLOCK_MONOTONIC && nanoseconds(until) >= EPOCH) \
      time = timespec_of(machine_ns() + nanoseconds(until) - simulated_ns()); \
    return BEHIND(name)(what, clock, &time); \
  }
BY_MACHINE(pthread_mutex_clocklock, pthread_mutex_t)
BY_MACHINE(pthread_rwlock_clockrdlock, pthread_rwlock_t)
BY_MACHINE(pthread_rwlock_clockwrlock, pthread_rwlock_t)
BY_MACHINE(sem_clockwait, sem_t)

/* Who waits for messages, for so long at most: executors, for a time-out or the next of their steady timers. Each wait
 * set has a guard condition of ours beside its own. */

struct entities { size_t count; void **each; };
struct guard { const char *implementation; void *data; };
struct limit { uint64_t s, ns; };
enum { KINDS = 5, GUARDS = 1, RMW_OK = 0, RMW_TIMEOUT = 2 };
static struct set { struct set *next; void *wait_set; struct guard *guard; } *sets;

extern void *rmw_create_wait_set(void *context, size_t most), *rmw_create_guard_condition(void *context);
extern int rmw_destroy_wait_set(void *set), rmw_destroy_guard_condition(void *guard);
extern int rmw_wait(struct entities *, struct entities *, struct entities *, struct entities *, struct entities *, void *,
                    const struct limit *);
extern void *malloc(size_t), free(void *);

OURS void *rmw_create_wait_set(void *context, size_t most) {
  bool ours = has_rclcpp();
  void *wait_set = BEHIND(rmw_create_wait_set)(context, most + ours);
  struct set *own = wait_set && ours ? malloc(sizeof *own) : NULL;
  if (own) {
    *own = (struct set){NULL, wait_set, BEHIND(rmw_create_guard_condition)(context)};
    hold();
    own->next = sets;
    sets = own;
    release();
  }
  return wait_set;
}

OURS int rmw_destroy_wait_set(void *wait_set) {
  struct set *own = NULL;
  hold();
  for (struct set **place = &sets; *place && !own; place = own ? place : &(*place)->next)
    if ((*place)->wait_set == wait_set) {
      own = *place;
      *place = own->next;
    }
  release();
  int failed = BEHIND(rmw_destroy_wait_set)(wait_set);
  if (own && own->guard) BEHIND(rmw_destroy_guard_condition)(own->guard);
  free(own);
  return failed;
}

static struct guard *guard_of(void *wait_set) {
  struct guard *found = NULL;
  hold();
  for (struct set *each = sets; each && !found; each = each->next)
    if (each->wait_set == wait_set) found = each->guard;
  release();
  return found;
}

OURS int rmw_wait(struct entities *subscriptions, struct entities *guards, struct entities *services,
                  struct entities *clients, struct entities *events, void *wait_set, const struct limit *limit) {
  struct guard *guard = limit && (limit->s || limit->ns) && LOAD(follows) ? guard_of(wait_set) : NULL;
  if (!guard) return BEHIND(rmw_wait)(subscriptions, guards, services, clients, events, wait_set, limit);
  int64_t length = limit->s < EPOCH / BILLION ? (int64_t)(limit->s * BILLION + limit->ns) : EPOCH;
  struct entities *given[KINDS] = {subscriptions, guards, services, clients, events};
  /* What is not ready is taken out of a list, and has to be there again for another round. */
  size_t count[KINDS], most = 1;
  for (int kind = 0; kind < KINDS; kind++) most += count[kind] = given[kind] ? given[kind]->count : 0;
  void *kept[most], *with_ours[count[GUARDS] + 1], **at = kept;
  for (int kind = 0; kind < KINDS; at += count[kind++])
    if (count[kind]) memcpy(at, given[kind]->each, count[kind] * sizeof *at);
  struct entities own_guards = {count[GUARDS] + 1, with_ours};
  struct waiter own = {.until = simulated_ns() + length, .guard = guard};
  add(&own);  /* a tick that comes before the wait below leaves the guard up */
  const struct limit at_once = {0, 0}, *past = own.woken == PAST ? &at_once : NULL;
  for (;;) {
    at = kept;
    for (int kind = 0; kind < KINDS; at += count[kind++])
      if (count[kind]) memcpy(kind == GUARDS ? with_ours : given[kind]->each, at, count[kind] * sizeof *at);
    with_ours[count[GUARDS]] = guard->data;
    int ended = BEHIND(rmw_wait)(subscriptions, &own_guards, services, clients, events, wait_set, past);
    if (count[GUARDS]) memcpy(guards->each, with_ours, count[GUARDS] * sizeof *with_ours);
    bool ready = ended != RMW_OK && ended != RMW_TIMEOUT;
    for (int kind = 0; kind < KINDS; kind++)
      for (size_t k = 0; k < count[kind]; k++) ready |= given[kind]->each[k] != NULL;
    /* The guard may still be up from the wait before. */
    if (ready || LOAD(own.woken)) {
      take_out(&own);
      if (!ready) take_turn();  /* what is ready anyhow would have been so without */
      return ready ? ended : RMW_TIMEOUT;
    }
  }
}
