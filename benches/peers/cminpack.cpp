// Rival: MINPACK's lmder in C, QR of the whole Jacobian.
#include <cminpack-1/cminpack.h>

#include <algorithm>

#include "problem.h"

struct State {
  const Problem& problem;
  int linearizations;
};

static int call(void* p, int, int, const double* x, double* f, double* jacobian, int, int flag) {
  State& state = *static_cast<State*>(p);
  if (flag == 2) state.linearizations += 1;
  static std::vector<double> room;
  room.resize(state.problem.residuals());
  state.problem(x, flag == 1 ? f : room.data(), flag == 2 ? jacobian : nullptr);
  return 0;
}

int main() {
  return serve([](int poses, const std::vector<double>& rows, const std::vector<double>& start) {
    const Problem problem(poses, rows);
    State state{problem, 0};
    const int m = problem.residuals(), n = PARAMETERS;
    Answer answer;
    std::copy(start.begin(), start.end(), answer.x);
    std::vector<double> f(m), jacobian(m * n);
    double scale[PARAMETERS], qtf[PARAMETERS], w1[PARAMETERS], w2[PARAMETERS], w3[PARAMETERS];
    std::vector<double> w4(m);
    int pivots[PARAMETERS], calls, derivatives;
    lmder(call, &state, m, n, answer.x, f.data(), jacobian.data(), m, 1e-15, 1e-8, 0.0, 200, scale, 1,
          100.0, 0, &calls, &derivatives, pivots, qtf, w1, w2, w3, w4.data());
    answer.linearizations = state.linearizations;
    return answer;
  });
}
