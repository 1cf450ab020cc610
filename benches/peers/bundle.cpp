// The bundle problems of the adjustment's benchmark, solved by Ceres: half the sum of squares, the
// fastest solve and the fastest covariance of the last camera's pose, as rows of a table.
//
//   bundle NAME FILE dots|bal THREADS REPEATS
//
// `dots`: every camera moves, interior orientations and control points are held.
// `bal`: focal length, k1 and k2 of every camera as well; nothing is held.

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

namespace {

struct Pinhole {
  double x, y, f, cx, cy;
  template <typename T>
  bool operator()(const T* pose, const T* point, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(pose, point, p);
    p[0] += pose[3];
    p[1] += pose[4];
    p[2] += pose[5];
    residual[0] = T(f) * p[0] / p[2] + T(cx) - T(x);
    residual[1] = T(f) * p[1] / p[2] + T(cy) - T(y);
    return true;
  }
};

struct InTheLarge {
  double x, y;
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    p[0] += camera[3];
    p[1] += camera[4];
    p[2] += camera[5];
    const T u = -p[0] / p[2];
    const T v = -p[1] / p[2];
    const T r2 = u * u + v * v;
    const T radial = T(1.0) + r2 * (camera[7] + camera[8] * r2);
    residual[0] = camera[6] * radial * u - T(x);
    residual[1] = camera[6] * radial * v - T(y);
    return true;
  }
};

struct Observation {
  int camera, point;
  double x, y;
};

struct Data {
  std::vector<Observation> observations;
  std::vector<double> cameras, interiors, points;
  int free_points = 0;
};

Data Read(const std::string& path, bool dots) {
  std::ifstream file(path);
  Data data;
  int cameras, points, controls = 0, observations;
  file >> cameras >> points;
  if (dots) file >> controls;
  file >> observations;
  data.observations.resize(observations);
  for (auto& o : data.observations) file >> o.camera >> o.point >> o.x >> o.y;
  for (int c = 0; c < cameras; ++c) {
    for (int i = 0; i < 9; ++i) {
      double value;
      file >> value;
      (dots && i >= 6 ? data.interiors : data.cameras).push_back(value);
    }
  }
  data.points.resize(3 * (points + controls));
  for (auto& value : data.points) file >> value;
  data.free_points = points;
  return data;
}

double Seconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) return 2;
  const bool dots = std::string(argv[3]) == "dots";
  const int threads = std::stoi(argv[4]);
  const int repeats = std::stoi(argv[5]);
  const Data start = Read(argv[2], dots);
  const int width = dots ? 6 : 9;
  double solve = 1e9, covariance_time = 1e9, cost = 0;
  for (int i = 0; i < repeats; ++i) {
    Data data = start;
    ceres::Problem problem;
    for (const auto& o : data.observations) {
      double* camera = &data.cameras[width * o.camera];
      double* point = &data.points[3 * o.point];
      if (dots) {
        const double* k = &data.interiors[3 * o.camera];
        problem.AddResidualBlock(
            new ceres::AutoDiffCostFunction<Pinhole, 2, 6, 3>(
                new Pinhole{o.x, o.y, k[0], k[1], k[2]}),
            nullptr, camera, point);
        if (o.point >= data.free_points) problem.SetParameterBlockConstant(point);
      } else {
        problem.AddResidualBlock(
            new ceres::AutoDiffCostFunction<InTheLarge, 2, 9, 3>(new InTheLarge{o.x, o.y}),
            nullptr, camera, point);
      }
    }
    ceres::Solver::Options options;
    // Few cameras: the reduced system is small and dense.
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.num_threads = threads;
    options.max_num_iterations = 100;
    if (dots) options.function_tolerance = 1e-10;
    ceres::Solver::Summary summary;
    auto since = std::chrono::steady_clock::now();
    ceres::Solve(options, &problem, &summary);
    solve = std::min(solve, Seconds(since));
    cost = summary.final_cost;
    if (dots) {
      ceres::Covariance::Options covariance_options;
      covariance_options.num_threads = threads;
      ceres::Covariance covariance(covariance_options);
      double* last = &data.cameras[width * (data.cameras.size() / width - 1)];
      since = std::chrono::steady_clock::now();
      const std::vector<std::pair<const double*, const double*>> blocks{{last, last}};
      if (covariance.Compute(blocks, &problem)) {
        covariance_time = std::min(covariance_time, Seconds(since));
      }
    }
  }
  std::printf("| %s | Ceres %s, %d thread%s | %.6f | %.3f ms |", argv[1], CERES_VERSION_STRING,
              threads, threads == 1 ? "" : "s", cost, 1e3 * solve);
  if (dots) {
    std::printf(" %.3f ms |\n", 1e3 * covariance_time);
  } else {
    std::printf(" |\n");
  }
}
