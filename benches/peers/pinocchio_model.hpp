// A Pinocchio model from a file of numbers, and the time of a call.
#pragma once

#include <pinocchio/algorithm/rnea.hpp>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <string>

// Every joint (revolute about z) is a line of 23 numbers: parent, rotation row by row, translation, mass, centre of mass,
// Ixx Ixy Iyy Ixz Iyz Izz about it. (The compiled URDF reader of the wheel aligns its matrices for SSE2; code compiled for a
// wider instruction set must make the model itself.)
inline pinocchio::Model Read(const char* path) {
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

inline volatile double sink;

// Nanoseconds of one of `calls` calls.
template <typename Call>
double TimeOf(int calls, Call call) {
  const auto start = std::chrono::steady_clock::now();
  for (int k = 0; k < calls; ++k) sink = call(k);
  const std::chrono::duration<double, std::nano> elapsed = std::chrono::steady_clock::now() - start;
  return elapsed.count() / calls;
}
