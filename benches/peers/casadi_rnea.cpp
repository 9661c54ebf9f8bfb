// Pinocchio's RNEA of an arm as C that CasADi generates. Usage: casadi_rnea MODEL.txt NAME, as pinocchio_model.hpp
// says; writes NAME.c.
#include <casadi/casadi.hpp>
#include <pinocchio/autodiff/casadi.hpp>

#include <cstdio>
#include <string>

#include "pinocchio_model.hpp"

int main(int, char** arguments) {
  using casadi::SX;
  const pinocchio::ModelTpl<SX> model = Read(arguments[1]).cast<SX>();
  pinocchio::DataTpl<SX> data(model);
  using Vector = Eigen::Matrix<SX, Eigen::Dynamic, 1>;
  const int n = model.nv;
  Vector arrays[3] = {Vector(n), Vector(n), Vector(n)};
  std::vector<SX> inputs;
  for (const char* name : {"q", "v", "a"}) {
    const SX input = SX::sym(name, n);
    Vector& array = arrays[inputs.size()];
    for (int k = 0; k < n; ++k) array[k] = input(k);
    inputs.push_back(input);
  }
  const Vector& tau = pinocchio::rnea(model, data, arrays[0], arrays[1], arrays[2]);
  SX output(n, 1);
  for (int k = 0; k < n; ++k) output(k) = tau[k];
  // Common terms once, as those who measure such code do.
  const casadi::Function function("casadi_rnea", inputs, {cse(output)});
  std::fprintf(stderr, "%lld operations\n", static_cast<long long>(function.n_instructions()));
  function.generate(std::string(arguments[2]) + ".c", {{"with_header", true}});
}
