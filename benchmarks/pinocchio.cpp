// The determinant of J J^T for many configurations, by Pinocchio in C++: a peer of batch.py.
// Arguments: model as saved by Pinocchio, tip frame, file of joint positions (doubles), threads, task rows.
// Prints seconds a configuration.
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <sstream>
#include <vector>

#include <omp.h>

#include <pinocchio/algorithm/centroidal.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/serialization.hpp>

int main(int, char** argv) {
  pinocchio::Model model;
  model.loadFromBinary(std::string(argv[1]));
  const auto tip = model.getFrameId(argv[2]);
  std::ifstream file(argv[3], std::ios::binary | std::ios::ate);
  const int n = model.nv - 6;
  const long m = file.tellg() / (n * sizeof(double));
  std::vector<double> Q(m * n), result(m);
  file.seekg(0);
  file.read(reinterpret_cast<char*>(Q.data()), Q.size() * sizeof(double));
  omp_set_num_threads(std::atoi(argv[4]));
  std::istringstream text(argv[5]);
  const std::vector<int> rows{std::istream_iterator<int>(text), {}};

  double best = 1e9;
  for (int round = 0; round < 7; ++round) {
    const auto start = std::chrono::steady_clock::now();
#pragma omp parallel
    {
      pinocchio::Data data(model);
      Eigen::VectorXd q = pinocchio::neutral(model);
      Eigen::MatrixXd J(6, model.nv), J_star(6, n), task(rows.size(), n);
#pragma omp for schedule(static)
      for (long i = 0; i < m; ++i) {
        q.tail(n) = Eigen::Map<const Eigen::VectorXd>(&Q[i * n], n);
        const auto& A = pinocchio::computeCentroidalMap(model, data, q);
        J.setZero();
        pinocchio::computeFrameJacobian(model, data, q, tip, pinocchio::LOCAL_WORLD_ALIGNED, J);
        const Eigen::Matrix<double, 6, 6> A_b = A.leftCols<6>();
        J_star = J.rightCols(n);
        J_star.noalias() -= J.leftCols<6>() * A_b.partialPivLu().solve(A.rightCols(n));
        for (std::size_t row = 0; row < rows.size(); ++row) task.row(row) = J_star.row(rows[row]);
        const Eigen::MatrixXd G = task * task.transpose();
        result[i] = G.ldlt().vectorD().prod();
      }
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    best = std::min(best, seconds.count() / m);
  }
  std::printf("%.9g\n", best);
}
