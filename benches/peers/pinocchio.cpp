// Pinocchio's dynamics on the same robots, one sample a call: nanoseconds per call, fastest of many batches.
// Usage: pinocchio MODEL.txt, where every joint (revolute about z) is a line of 23 numbers: parent, rotation row by row,
// translation, mass, centre of mass, Ixx Ixy Iyy Ixz Iyz Izz about it. (The compiled URDF reader of the wheel aligns its
// matrices for SSE2; code compiled for a wider instruction set must make the model itself.)
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

namespace {

constexpr int kStates = 256;
constexpr int kBatches = 400;
volatile double sink;

template <typename Call>
void Measure(const char* what, Call call) {
  double fastest = 1e300;
  for (int batch = 0; batch < kBatches; ++batch) {
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < kStates; ++k) sink = call(k);
    const std::chrono::duration<double, std::nano> elapsed = std::chrono::steady_clock::now() - start;
    fastest = std::min(fastest, elapsed.count() / kStates);
  }
  std::printf("%s %.1f\n", what, fastest);
}

pinocchio::Model Read(const char* path) {
  pinocchio::Model model;
  std::ifstream file(path);
  int parent;
  while (file >> parent) {
    Eigen::Matrix3d rotation, inertia;
    Eigen::Vector3d translation, centre;
    double mass, xx, xy, yy, xz, yz, zz;
    for (int k = 0; k < 9; ++k) file >> rotation(k / 3, k % 3);
    for (int k = 0; k < 3; ++k) file >> translation[k];
    file >> mass;
    for (int k = 0; k < 3; ++k) file >> centre[k];
    file >> xx >> xy >> yy >> xz >> yz >> zz;
    inertia << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    const auto name = "joint_" + std::to_string(model.njoints);
    const auto joint = model.addJoint(parent, pinocchio::JointModelRZ(), pinocchio::SE3(rotation, translation), name);
    model.appendBodyToJoint(joint, pinocchio::Inertia(mass, centre, inertia));
  }
  return model;
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
