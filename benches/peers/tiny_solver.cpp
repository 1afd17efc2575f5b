// Rival: ceres::TinySolver, normal equations with a Cholesky of fixed size.
#include <ceres/tiny_solver.h>

#include <algorithm>

#include "problem.h"

struct Function {
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = PARAMETERS };
  const Problem& problem;
  mutable int linearizations = 0;

  int NumResiduals() const { return problem.residuals(); }
  bool operator()(const double* x, double* f, double* jacobian) const {
    linearizations += jacobian != nullptr;
    problem(x, f, jacobian);
    return true;
  }
};

int main() {
  return serve([](int poses, const std::vector<double>& rows, const std::vector<double>& start) {
    const Problem problem(poses, rows);
    const Function function{problem};
    ceres::TinySolver<Function> solver;
    solver.options.parameter_tolerance = 1e-8;  // its default
    solver.options.function_tolerance = 1e-15;  // absolute, whatever its comment says
    solver.options.gradient_tolerance = 1e-14;
    solver.options.cost_threshold = 0;
    Eigen::Matrix<double, PARAMETERS, 1> x;
    std::copy(start.begin(), start.end(), x.data());
    solver.Solve(function, &x);
    Answer answer;
    std::copy(x.data(), x.data() + PARAMETERS, answer.x);
    answer.linearizations = function.linearizations;
    return answer;
  });
}
