// Rival: ceres::Solver with its dense normal equations, one cost function for all poses.
#include <ceres/ceres.h>

#include <algorithm>

#include "problem.h"

class Cost : public ceres::CostFunction {
 public:
  mutable int linearizations = 0;

  explicit Cost(const Problem& given) : problem(given), columns(given.residuals() * PARAMETERS) {
    set_num_residuals(given.residuals());
    mutable_parameter_block_sizes()->push_back(PARAMETERS);
  }

  bool Evaluate(double const* const* x, double* f, double** jacobians) const override {
    const bool wanted = jacobians && jacobians[0];
    problem(x[0], f, wanted ? columns.data() : nullptr);
    if (wanted) {
      linearizations += 1;
      const int m = problem.residuals();
      for (int c = 0; c < PARAMETERS; ++c)
        for (int r = 0; r < m; ++r) jacobians[0][r * PARAMETERS + c] = columns[c * m + r];
    }
    return true;
  }

 private:
  const Problem& problem;
  mutable std::vector<double> columns;
};

int main() {
  return serve([](int poses, const std::vector<double>& rows, const std::vector<double>& start) {
    const Problem parts(poses, rows);
    Cost cost(parts);
    Answer answer;
    std::copy(start.begin(), start.end(), answer.x);
    ceres::Problem::Options owns;
    owns.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(owns);
    problem.AddResidualBlock(&cost, nullptr, answer.x);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.num_threads = 1;
    options.parameter_tolerance = 1e-8;  // its default
    options.function_tolerance = 1e-14;
    options.gradient_tolerance = 1e-14;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    answer.linearizations = cost.linearizations;
    return answer;
  });
}
