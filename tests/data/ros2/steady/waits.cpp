// Waits for 70 ms of the steady clock in a thread of its own, as its first argument says; the others are what simulated
// time it is told, in ms, each once the thread sleeps; one with an "a" is told to one of its two clocks alone. Says what
// it was told last when the wait was over, and how much the steady clock went on, in ms.
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <future>
#include <map>
#include <mutex>
#include <string>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>

extern "C" int rcl_enable_ros_time_override(void *), rcl_set_ros_time_override(void *, long);
extern "C" int rcl_publish(const void *, const void *, void *);
double middleware_slept();

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

std::mutex mutex;
std::condition_variable condition;
std::promise<int> promise;
std::timed_mutex held;
std::atomic<bool> over{false}, told{false};
const auto EARLY = std::chrono::system_clock::now() + 20ms;  // by the machine's clock

void wait_for_condition() {
  std::unique_lock<std::mutex> lock(mutex);
  condition.wait_for(lock, 70ms, []() { return told.load(); });
}

const std::map<std::string, void (*)()> WAITS = {
  {"sleep_for", []() { std::this_thread::sleep_for(70ms); }},
  {"sleep_until", []() { std::this_thread::sleep_until(Clock::now() + 70ms); }},
  {"system", []() { std::this_thread::sleep_until(std::chrono::system_clock::now() + 70ms); }},
  {"system_condition", []() {
     std::unique_lock<std::mutex> lock(mutex);
     condition.wait_until(lock, std::chrono::system_clock::now() + 70ms, []() { return told.load(); }); }},
  {"system_future", []() { promise.get_future().wait_until(std::chrono::system_clock::now() + 70ms); }},
  {"early", []() {
     std::unique_lock<std::mutex> lock(mutex);
     condition.wait_until(lock, EARLY, []() { return told.load(); }); }},
  {"usleep", []() { usleep(70000); }},
  {"sleep_after_publishing", []() { rcl_publish("/cmd_vel", "", nullptr); std::this_thread::sleep_for(70ms); }},
  {"sleep_after_parameters", []() { rcl_publish("/parameter_events", "", nullptr); std::this_thread::sleep_for(70ms); }},
  {"condition", wait_for_condition},
  {"notified", wait_for_condition},
  {"future", []() { promise.get_future().wait_for(70ms); }},
  {"fulfilled", []() { promise.get_future().wait_for(70ms); }},
  {"lock", []() { if (held.try_lock_for(70ms)) std::abort(); }},
  {"middleware", []() { std::printf("%d ", middleware_slept() >= 0.002); }},
};

// Returns once the thread waits as the library lets it, or has ended; a nap until its turn comes is another call. Of a
// thread that was woken, and is not in a core's queue yet, the kernel still tells the call that it waited in; its state
// is that of one that runs.
void settle(int thread) {
  const std::string task = "/proc/self/task/" + std::to_string(thread);
  for (bool waits = false; !waits && !over; std::this_thread::yield()) {
    std::string stat;
    std::getline(std::ifstream(task + "/stat"), stat);
    const auto name_end = stat.rfind(") ");
    long call = -1;
    const bool asleep = name_end != std::string::npos && stat[name_end + 2] == 'S';
    waits = asleep && std::ifstream(task + "/syscall") >> call && call == SYS_futex;
  }
}

int main(int count, char **words) {
  const std::string kind = words[1];
  long clocks[2] = {};  // of two nodes
  for (auto &clock : clocks) rcl_enable_ros_time_override(&clock), rcl_set_ros_time_override(&clock, 0);
  held.lock();
  std::atomic<int> thread{0};
  const auto begun = Clock::now();
  std::thread waiter([&]() { thread = gettid(); WAITS.at(kind)(); over = true; });
  while (!thread) std::this_thread::yield();
  const char *ended = "never";
  for (int k = 2; k < count; ++k) {
    settle(thread);
    if (over) break;
    const bool first_alone = std::string(words[k]).back() == 'a';
    for (auto &clock : clocks)
      if (&clock == clocks || !first_alone) rcl_set_ros_time_override(&clock, std::atol(words[k]) * 1000000);
    ended = words[k];
    if (kind == "notified") { { std::lock_guard<std::mutex> lock(mutex); told = true; } condition.notify_all(); }
    if (kind == "fulfilled") promise.set_value(1);
  }
  waiter.join();
  std::printf("%s %ld\n", ended, long((Clock::now() - begun) / 1ms));
  return 0;
}
