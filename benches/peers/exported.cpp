// Exported models against Pinocchio's RNEA, and against the C that CasADi generates of it if WITH_CASADI is defined, in
// turn: nanoseconds per call, fastest of many batches. Usage: exported MODEL.txt, as pinocchio_model.hpp says, for the
// robot of rigid.h, found.h and casadi_rnea.h.
#include <cmath>
#include <cstdio>
#include <vector>

#include "found.h"
#include "pinocchio_model.hpp"
#include "rigid.h"

#ifdef WITH_CASADI
#include "casadi_rnea.h"

// Of a robot without effects, as CasADi wants its arrays.
inline void CasadiRnea(const double* q, const double* v, const double* a, double* tau) {
  const double* arguments[casadi_rnea_SZ_ARG] = {q, v, a};
  double* results[casadi_rnea_SZ_RES] = {tau};
  casadi_rnea(arguments, results, nullptr, nullptr, 0);
}
#endif

// The same robot, or the comparison says nothing.
inline bool IsLike(const Eigen::VectorXd& wanted, const double* tau) {
  for (int joint = 0; joint < wanted.size(); ++joint) {
    if (std::abs(tau[joint] - wanted[joint]) > 1e-9) return false;
  }
  return true;
}

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
  for (int k = 0; k < kStates; ++k) {
    const Eigen::VectorXd wanted = pinocchio::rnea(model, data, q[k], v[k], a[k]);
    sgpr_rigid_torque(&rigid, q[k].data(), v[k].data(), a[k].data(), tau);
    if (!IsLike(wanted, tau)) return 1;
#ifdef WITH_CASADI
    CasadiRnea(q[k].data(), v[k].data(), a[k].data(), tau);
    if (!IsLike(wanted, tau)) return 2;
#endif
  }
#ifdef WITH_CASADI
  constexpr int kKinds = 4;
#else
  constexpr int kKinds = 3;
#endif
  double fastest[kKinds];
  std::fill(fastest, fastest + kKinds, 1e300);
  for (int batch = 0; batch < kBatches; ++batch) {
    const double times[kKinds] = {
        TimeOf(kStates, [&](int k) { return pinocchio::rnea(model, data, q[k], v[k], a[k])[0]; }),
        TimeOf(kStates, [&](int k) {
          sgpr_rigid_torque(&rigid, q[k].data(), v[k].data(), a[k].data(), tau);
          return tau[0];
        }),
        TimeOf(kStates, [&](int k) {
          sgpr_found_torque(&found, q[k].data(), v[k].data(), a[k].data(), tau);
          return tau[0];
        }),
#ifdef WITH_CASADI
        TimeOf(kStates, [&](int k) {
          CasadiRnea(q[k].data(), v[k].data(), a[k].data(), tau);
          return tau[0];
        }),
#endif
    };
    for (int kind = 0; kind < kKinds; ++kind) fastest[kind] = std::min(fastest[kind], times[kind]);
  }
  const char* names[4] = {"pinocchio_rnea", "exported_rigid_body", "exported_with_effects_and_five_findings",
                          "casadi_of_pinocchio_rnea"};
  for (int kind = 0; kind < kKinds; ++kind) std::printf("%s %.1f\n", names[kind], fastest[kind]);
}
