// Casts rays with range_libc as often as it is asked, and writes what it measured. Compiled by range_libc.py.
//
// Arguments: map file, poses file, ranges file, method, slices of the turn, turns, rays, longest range in cells.
// The map: width, height (int32), then a byte a cell, column after column. Poses: x, y in cells, yaw in radians
// (float32). Written: for each turn the processor's seconds, and the ranges of the last turn.
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <memory>
#include <string>
#include <vector>

#include "includes/RangeLib.h"

static std::vector<char> read_all(const char* path) {
  std::vector<char> bytes;
  FILE* file = fopen(path, "rb");
  if (!file) return bytes;
  for (int c; (c = fgetc(file)) != EOF;) bytes.push_back(static_cast<char>(c));
  fclose(file);
  return bytes;
}

static std::unique_ptr<ranges::RangeMethod> method_of(const std::string& name, ranges::OMap& map, float far, int slices) {
  if (name == "bresenham") return std::make_unique<ranges::BresenhamsLine>(map, far);
  if (name == "ray marching") return std::make_unique<ranges::RayMarching>(map, far);
  if (name == "lookup table") return std::make_unique<ranges::GiantLUTCast>(map, far, slices);
  auto cddt = std::make_unique<ranges::CDDTCast>(map, far, slices);
  if (name == "pruned CDDT") cddt->prune(far);
  return cddt;
}

int main(int argc, char** argv) {
  if (argc != 9) return 2;
  const std::vector<char> cells = read_all(argv[1]), poses = read_all(argv[2]);
  const int32_t* size = reinterpret_cast<const int32_t*>(cells.data());
  ranges::OMap map(size[0], size[1]);
  for (int x = 0; x < size[0]; ++x)
    for (int y = 0; y < size[1]; ++y) map.grid[x][y] = cells[8 + x * size[1] + y] != 0;
  const int slices = atoi(argv[5]), turns = atoi(argv[6]), rays = atoi(argv[7]);
  auto method = method_of(argv[4], map, atof(argv[8]), slices);
  const float* pose = reinterpret_cast<const float*>(poses.data());
  const size_t count = poses.size() / (3 * sizeof(float));
  std::vector<float> found(count * rays);
  for (int turn = 0; turn < turns; ++turn) {
    const clock_t begun = clock();
    for (size_t k = 0; k < count; ++k)
      for (int ray = 0; ray < rays; ++ray)
        found[k * rays + ray] =
            method->calc_range(pose[3 * k], pose[3 * k + 1], pose[3 * k + 2] + float(2.0 * M_PI) * ray / rays);
    printf("%.9f\n", double(clock() - begun) / CLOCKS_PER_SEC);
  }
  FILE* file = fopen(argv[3], "wb");
  fwrite(found.data(), sizeof(float), found.size(), file);
  fclose(file);
  return 0;
}
