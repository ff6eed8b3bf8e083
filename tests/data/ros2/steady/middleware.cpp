// A library that is called as Fast DDS is: it has the machine's clock.
#include <chrono>
#include <thread>
double middleware_slept() {
  auto begun = std::chrono::steady_clock::now();
  std::this_thread::sleep_for(std::chrono::milliseconds(2));
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}
