// Pinocchio's dynamics on the same robots, one sample a call: nanoseconds per call, fastest of many batches.
// Usage: pinocchio MODEL.txt, as pinocchio_model.hpp says.
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/regressor.hpp>

#include <cstdio>
#include <vector>

#include "pinocchio_model.hpp"

namespace {

constexpr int kStates = 256;
constexpr int kBatches = 400;

template <typename Call>
void Measure(const char* what, Call call) {
  double fastest = 1e300;
  for (int batch = 0; batch < kBatches; ++batch) fastest = std::min(fastest, TimeOf(kStates, call));
  std::printf("%s %.1f\n", what, fastest);
}

}  // namespace

int main(int, char** arguments) {
  const pinocchio::Model model = Read(arguments[1]);
  pinocchio::Data data(model);
  std::vector<Eigen::VectorXd> q, v, a, tau;
  for (int k = 0; k < kStates; ++k) {
    q.push_back(3.0 * Eigen::VectorXd::Random(model.nq));
    v.push_back(2.0 * Eigen::VectorXd::Random(model.nv));
    a.push_back(5.0 * Eigen::VectorXd::Random(model.nv));
    tau.push_back(20.0 * Eigen::VectorXd::Random(model.nv));
  }
  Measure("rnea", [&](int k) { return pinocchio::rnea(model, data, q[k], v[k], a[k])[0]; });
  Measure("aba", [&](int k) { return pinocchio::aba(model, data, q[k], v[k], tau[k])[0]; });
  Measure("crba", [&](int k) { return pinocchio::crba(model, data, q[k])(0, 0); });
  Measure("regressor", [&](int k) { return pinocchio::computeJointTorqueRegressor(model, data, q[k], v[k], a[k])(0, 0); });
}
