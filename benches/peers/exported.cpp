// Exported models against Pinocchio's RNEA, in turn: nanoseconds per call, fastest of many batches.
// Usage: exported MODEL.txt, as pinocchio_model.hpp says, for the robot of rigid.h and found.h.
#include <cmath>
#include <cstdio>
#include <vector>

#include "found.h"
#include "pinocchio_model.hpp"
#include "rigid.h"

int main(int, char** arguments) {
  constexpr int kStates = 256;
  constexpr int kBatches = 2000;
  const pinocchio::Model model = Read(arguments[1]);
  pinocchio::Data data(model);
  std::vector<Eigen::VectorXd> q, v, a;
  for (int k = 0; k < kStates; ++k) {
    q.push_back(3.0 * Eigen::VectorXd::Random(model.nq));
    v.push_back(2.0 * Eigen::VectorXd::Random(model.nv));
    a.push_back(5.0 * Eigen::VectorXd::Random(model.nv));
  }
  static sgpr_rigid_state rigid;
  static sgpr_found_state found;
  sgpr_rigid_reset(&rigid);
  sgpr_found_reset(&found);
  double tau[SGPR_RIGID_JOINTS];
  // The same robot, or the comparison says nothing.
  for (int k = 0; k < kStates; ++k) {
    sgpr_rigid_torque(&rigid, q[k].data(), v[k].data(), a[k].data(), tau);
    const Eigen::VectorXd wanted = pinocchio::rnea(model, data, q[k], v[k], a[k]);
    for (int joint = 0; joint < SGPR_RIGID_JOINTS; ++joint) {
      if (std::abs(tau[joint] - wanted[joint]) > 1e-9) return 1;
    }
  }
  double fastest[3] = {1e300, 1e300, 1e300};
  for (int batch = 0; batch < kBatches; ++batch) {
    const double times[3] = {
        TimeOf(kStates, [&](int k) { return pinocchio::rnea(model, data, q[k], v[k], a[k])[0]; }),
        TimeOf(kStates, [&](int k) {
          sgpr_rigid_torque(&rigid, q[k].data(), v[k].data(), a[k].data(), tau);
          return tau[0];
        }),
        TimeOf(kStates, [&](int k) {
          sgpr_found_torque(&found, q[k].data(), v[k].data(), a[k].data(), tau);
          return tau[0];
        }),
    };
    for (int kind = 0; kind < 3; ++kind) fastest[kind] = std::min(fastest[kind], times[kind]);
  }
  const char* names[3] = {"pinocchio_rnea", "exported_rigid_body", "exported_with_effects_and_five_findings"};
  for (int kind = 0; kind < 3; ++kind) std::printf("%s %.1f\n", names[kind], fastest[kind]);
}
