// Runs the stereo odometry of libviso2 on raw pictures, for a comparison. Links with that library, of which nothing is here.
//
// viso2_driver FRAMES WIDTH HEIGHT FOCAL_PX COLUMN_PX ROW_PX BASELINE_M HALF_RESOLUTION REFINEMENT
//
// FRAMES holds pairs of grey pictures one after the other, left before right. A line a pair: the three rows of the left
// camera's pose in the first one, whether the library said that it succeeded, and the processor time in milliseconds.

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <vector>

#include <viso_stereo.h>

int main(int count, char** words) {
  if (count != 10) return 2;
  const int width = std::atoi(words[2]), height = std::atoi(words[3]);
  VisualOdometryStereo::parameters parameters;
  parameters.calib.f = std::atof(words[4]);
  parameters.calib.cu = std::atof(words[5]);
  parameters.calib.cv = std::atof(words[6]);
  parameters.base = std::atof(words[7]);
  parameters.match.half_resolution = std::atoi(words[8]);
  parameters.match.refinement = std::atoi(words[9]);
  VisualOdometryStereo odometry(parameters);
  std::FILE* file = std::fopen(words[1], "rb");
  if (file == nullptr) return 2;
  std::vector<uint8_t> left(width * height), right(width * height);
  Matrix pose = Matrix::eye(4);
  int32_t size[] = {width, height, width};
  while (std::fread(left.data(), 1, left.size(), file) == left.size() &&
         std::fread(right.data(), 1, right.size(), file) == right.size()) {
    const std::clock_t begin = std::clock();
    const bool is_good = odometry.process(left.data(), right.data(), size);
    const double cost_ms = 1e3 * double(std::clock() - begin) / CLOCKS_PER_SEC;
    if (is_good) pose = pose * Matrix::inv(odometry.getMotion());
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column) std::printf("%.9f ", pose.val[row][column]);
    std::printf("%d %.4f\n", is_good ? 1 : 0, cost_ms);
  }
  std::fclose(file);
  return 0;
}
